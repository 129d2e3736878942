"""Sums over some checks with one set of further known errors after another.

The stack's own known errors are summed once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import F64
from armd.compensation.interim.evidence.elimination import CheckSums
from armd.compensation.interim.evidence.stack import Stack


class ExtendedSums:
    """Sums over the checks *chosen* of a stack, with further known errors."""

    def __init__(self, stack: Stack, chosen: Sequence[int]) -> None:
        self._chosen = list(chosen)
        self._error_columns = self._stacked(stack.error_columns)
        self._residual = self._stacked(stack.residual)
        self._sums = stack.sum_checks(self._chosen)

    def sum_with(self, extra: Sequence[F64]) -> CheckSums:
        """Return the sums with *extra* known errors, (r, ·) of every check of the stack.

        They equal those of a stack with these errors (`Stack.add_known_errors`).
        """
        added = self._stacked(extra)
        across = self._error_columns.T @ added
        return CheckSums(
            np.block([[self._sums.curvature, across], [across.T, added.T @ added]]),
            np.concatenate([self._sums.side, added.T @ self._residual]),
            self._sums.square,
            self._sums.numbers,
        )

    def _stacked(self, rows_of_checks: Sequence[F64]) -> F64:
        """Stack the rows of the chosen checks; there may be none."""
        return np.concatenate([rows_of_checks[0][:0], *(rows_of_checks[i] for i in self._chosen)])

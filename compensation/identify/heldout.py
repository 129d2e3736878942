"""Errors on readings that took no part: placements or temperatures left out, one set at a time.

About the solution the model is linear far beyond the noise, so a fit without some readings is one
small linear problem. Of the readings left out only placements and seats are fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from armd.compensation.identify.elimination import Elimination
from armd.compensation.identify.fit import Fit, rms_um
from armd.compensation.identify.linearise import Linearisation
from armd.compensation.identify.noise import robust_weights, whitening
from armd.compensation.identify.observations import Observations
from armd.compensation.identify.solution import Solution, solve

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

MOST_FOLDS = 8


class HeldOut:
    """A linear model around a fit, fitted without a fold's readings and tried on these.

    *columns* (n, 3, C) mm and *scale* (C,): the unknowns any of the models to compare may use;
    *residual* (n, 3) mm where all of these stand at their start, and *pull* (C,) from there to the
    drawing, which keeps what a fold's other readings do not know.
    """

    def __init__(
        self,
        fit: Fit,
        columns: F64,
        scale: F64,
        residual: F64,
        pull: F64,
        folds: Sequence[Mask],
    ) -> None:
        joints = fit.at.joints
        whiten = whitening(fit.noise.covariance(joints), robust_weights(fit.distance2))
        good = np.ones(fit.observations.n, dtype=bool)
        good[fit.outliers] = False
        self.scale, self.pull = scale, pull
        # Rows the robust loss set aside say nothing about the model's error: never a test.
        base = replace(fit.at, residual_mm=residual)
        self.folds = [
            _Fold(base, whiten, columns, ~out, out & good) for out in folds if (out & good).any()
        ]

    def solve(self, fold: int, chosen: I64) -> Solution:
        """The chosen unknowns' changes (len(chosen),), fitted without the fold."""
        triangle = self.folds[fold].triangle[:, [*chosen, -1]]
        scale = self.scale[chosen]
        triangle = np.asarray(np.linalg.qr(triangle * [*scale, 1.0], mode="r"))
        return solve(triangle, scale, self.pull[chosen])

    def residuals(self, chosen: I64) -> list[F64]:
        """Residuals (m, 3) mm of each fold's readings, of a fit of *chosen* without them."""
        return [fold.tried(chosen, self.solve(i, chosen).step) for i, fold in enumerate(self.folds)]

    def rms_um(self, chosen: I64) -> float:
        """3-D RMS over all folds."""
        return rms_um(np.concatenate(self.residuals(chosen)))


class _Fold:
    """One set of readings left out; *kept* and *test* are rows, *base* stands at the start."""

    def __init__(
        self, base: Linearisation, whiten: F64, columns: F64, kept: Mask, test: Mask
    ) -> None:
        self._base, self._all_columns, self._test = base, columns, test
        training = Elimination(base.rows(kept), whiten[kept])
        clear = np.column_stack([training.columns(columns[kept]), training.residual()])
        self.triangle = np.asarray(np.linalg.qr(clear, mode="r"))

    @cached_property
    def _trial(self) -> tuple[F64, F64]:
        """Columns (3 m, C) and residuals (3 m,) of the test readings, at their best poses."""
        at = self._base.rows(self._test)
        alike = np.tile(np.eye(3), (at.observations.n, 1, 1))
        trial = Elimination(at, alike, length_floor_mm=np.inf)
        columns = trial.columns(self._all_columns[self._test])
        return columns[trial.reading_rows], trial.residual()[trial.reading_rows]

    def tried(self, chosen: I64, change: F64) -> F64:
        """Residuals (m, 3) mm of the test readings after a change of the chosen unknowns."""
        columns, residual = self._trial
        return (residual + columns[:, chosen] @ change).reshape(-1, 3)


def placement_folds(observations: Observations) -> tuple[list[Mask], str]:
    """Sets of whole placements to leave out, and by what they are told apart.

    With one placement only, every eighth reading is left out instead, its pose being fitted to
    these: weaker, and said so.
    """
    used = np.unique(observations.placement)
    if len(used) > 1:
        fold_of = {int(p): i % min(MOST_FOLDS, len(used)) for i, p in enumerate(used)}
        fold = np.array([fold_of[int(p)] for p in observations.placement])
        by = "placement"
    else:
        fold = np.arange(observations.n) % MOST_FOLDS
        by = "reading"
    return [fold == i for i in np.unique(fold)], by

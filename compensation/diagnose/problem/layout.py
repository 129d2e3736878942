"""Which of the columns that absorb belong to whom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.estimate.linear import linear_model

PLACEMENTS, IDENTIFIED, MOUNT, EXPANSIONS, TARGETS, DRIFT = (
    "placements and seats",
    "identified",
    "mount",
    "expansions",
    "targets",
    "drift",
)
#: Always there, before the blocks of the findings and after them.
BEFORE, AFTER = (PLACEMENTS, IDENTIFIED), (MOUNT, EXPANSIONS, TARGETS, DRIFT)


@dataclass(frozen=True)
class FitLayout:
    """Which of the nuisance columns belong to whom."""

    blocks: linear_model.Layout
    nominal_variance: (
        F64  # (b,) variance with which to choose where the data leave it open; inf: none
    )

    @property
    def identified(self) -> slice:
        """Constants and terms (when held: the directions of their covariance)."""
        return self.blocks[IDENTIFIED]

    @property
    def findings(self) -> tuple[slice, ...]:
        """Of each finding."""
        return tuple(self.blocks[name_block(i)] for i in range(self._n_findings))

    @property
    def mount(self) -> slice:
        """One column or none: the first link's growth, see `make_mount_term`."""
        return self.blocks[MOUNT]

    @property
    def shared(self) -> int:
        """First of those that targets and drift share."""
        return int(self.blocks[TARGETS].start)

    @property
    def drift(self) -> slice:
        """Of the wandering base."""
        return self.blocks[DRIFT]

    @property
    def _n_findings(self) -> int:
        return len(self.blocks.sizes) - len(BEFORE) - len(AFTER)

    def with_findings(self, counts: Sequence[int]) -> FitLayout:
        """With findings of so many columns each in the place of those that it has."""
        first, stop = self.identified.stop, self.mount.start
        free_variance = np.full(sum(counts), np.inf)
        nominal_variance = np.concatenate(
            [self.nominal_variance[:first], free_variance, self.nominal_variance[stop:]]
        )
        sizes = self.blocks.sizes
        finding_sizes = tuple((name_block(i), int(count)) for i, count in enumerate(counts))
        return FitLayout(
            linear_model.Layout((*sizes[: len(BEFORE)], *finding_sizes, *sizes[-len(AFTER) :])),
            nominal_variance,
        )


def name_block(index: int) -> str:
    """The name of a finding's block."""
    return f"finding {index + 1}"


def select_findings(layout: FitLayout, numbers: Sequence[int]) -> tuple[I64, FitLayout]:
    """Which nuisance columns stay with the findings of these *numbers*, and their layout."""
    finding_names = [name_block(i) for i in numbers]
    columns = layout.blocks.find_columns([*BEFORE, *finding_names, *AFTER])
    sizes = dict(layout.blocks.sizes)
    return columns, layout.with_findings([sizes[name] for name in finding_names])

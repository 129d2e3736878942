"""The layout of the nuisance columns: which of them belong to which block."""

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
#: Blocks that every fit has, before those of the findings and after them.
BEFORE, AFTER = (PLACEMENTS, IDENTIFIED), (MOUNT, EXPANSIONS, TARGETS, DRIFT)


@dataclass(frozen=True)
class FitLayout:
    """The nuisance columns by block, and the nominal prior of their amplitudes."""

    blocks: linear_model.Layout
    nominal_variance: (
        F64  # (b,) variance of the nominal prior where data leave a direction open; inf: none
    )

    @property
    def identified(self) -> slice:
        """The columns of constants and terms; when given, the directions of their covariance."""
        return self.blocks[IDENTIFIED]

    @property
    def findings(self) -> tuple[slice, ...]:
        """The columns of each finding."""
        return tuple(self.blocks[name_block(i)] for i in range(self._n_findings))

    @property
    def mount(self) -> slice:
        """The column of the first link's growth, one or none; see `make_mount_term`."""
        return self.blocks[MOUNT]

    @property
    def shared(self) -> int:
        """The first of the columns of noise that rests share: targets and drift."""
        return int(self.blocks[TARGETS].start)

    @property
    def drift(self) -> slice:
        """The columns of the drifting base."""
        return self.blocks[DRIFT]

    @property
    def _n_findings(self) -> int:
        return len(self.blocks.sizes) - len(BEFORE) - len(AFTER)

    def with_findings(self, counts: Sequence[int]) -> FitLayout:
        """Return the layout with the findings replaced by blocks of these *counts* of columns."""
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
    """Return the name of a finding's block."""
    return f"finding {index + 1}"


def select_findings(layout: FitLayout, numbers: Sequence[int]) -> tuple[I64, FitLayout]:
    """Return the columns that remain with the findings of these *numbers*, and their layout."""
    finding_names = [name_block(i) for i in numbers]
    columns = layout.blocks.find_columns([*BEFORE, *finding_names, *AFTER])
    sizes = dict(layout.blocks.sizes)
    return columns, layout.with_findings([sizes[name] for name in finding_names])

"""Errors on readings that took no part: placements or temperatures left out, one set at a time.

About the solution the model is linear far beyond the noise, so a fit without some readings is one
small linear problem. Of the readings left out only the placements are fitted, and seats that no
other reading touched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.folds import whole_groups
from armd.compensation.estimate.linearise import Linearisation
from armd.compensation.estimate.noise import whitening
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.robust import redescending_weights
from armd.compensation.estimate.solution import Solution, solve
from armd.compensation.identify.elimination import Elimination
from armd.compensation.identify.fit import Identification, rms_um

MOST_FOLDS = 8


class HeldOut:
    """A linear model around a fit, fitted without a fold's readings and tried on all of these.

    *columns* (n, 3, C) mm and *scale* (C,): the unknowns any of the models to compare may use;
    *residual* (n, 3) mm where all of these stand at their start, and *pull* (C,) from there to the
    drawing, which keeps what a fold's other readings do not know.
    """

    def __init__(
        self,
        fit: Identification,
        columns: F64,
        scale: F64,
        residual: F64,
        pull: F64,
        folds: Sequence[Mask],
    ) -> None:
        weight = redescending_weights(fit.distance2, fit.region)
        whiten = whitening(fit.noise.covariance(fit.at.joints), weight)
        self.scale, self.pull = scale, pull
        base = replace(fit.at, residual_mm=residual)
        self.folds = [_Fold(base, whiten, weight, columns, out) for out in folds if out.any()]
        self._kept = [~np.isin(np.flatnonzero(out), fit.weighed_down) for out in folds if out.any()]

    def solve(self, fold: int, chosen: I64) -> Solution:
        """The chosen unknowns' changes (len(chosen),), fitted without the fold."""
        triangle = self.folds[fold].triangle[:, [*chosen, -1]]
        scale = self.scale[chosen]
        triangle = np.asarray(np.linalg.qr(triangle * [*scale, 1.0], mode="r"))
        return solve(triangle, scale, self.pull[chosen])

    def errors(self, chosen: I64) -> Errors:
        """Of fits of *chosen* without each fold, on the fold."""
        tried = [
            fold.tried(chosen, self.solve(i, chosen).step) for i, fold in enumerate(self.folds)
        ]
        return self.of(tried)

    def of(self, tried: Sequence[F64]) -> Errors:
        """Of residuals (m, 3) mm, fold by fold."""
        residual, kept = np.concatenate(tried), np.concatenate(self._kept)
        return Errors(rms_um(residual), rms_um(residual[kept]), int((~kept).sum()))


@dataclass(frozen=True)
class Errors:
    """3-D RMS of all readings left out in turn, and without those weighed down."""

    rms_um: float
    without_far_um: float
    n_far: int

    def in_words(self) -> str:
        """Both figures where they differ, in one line."""
        beside = f" ({self.without_far_um:.2f} without the {self.n_far} far off)"
        return f"{self.rms_um:.2f} µm" + beside * (self.n_far > 0)


class _Fold:
    """One set of readings left out; *base* stands at the start."""

    def __init__(
        self, base: Linearisation, whiten: F64, weight: F64, columns: F64, out: Mask
    ) -> None:
        self._base, self._columns, self._out = base, columns, out
        self._weight = weight[out]  # a reading gone wrong does not move its placement
        self._training = Elimination(base.rows(~out), whiten[~out])
        clear = np.column_stack([self._training.columns(columns[~out]), self._training.residual()])
        self.triangle = np.asarray(np.linalg.qr(clear, mode="r"))

    @cached_property
    def _trial(self) -> Elimination | None:
        """What is fitted to the readings left out: poses that no other reading tells, and seats."""
        own = self._base.rows(self._out)
        placement, target = own.observations.placement, own.observations.target
        others = self._training.at.observations
        told = np.isin(placement, others.placement)
        if told.all():
            return None
        pose_columns = np.where(told[:, None, None], 0.0, own.pose_columns)
        seats = np.setdiff1d(own.free_targets, self._training.at.free_targets)
        shifting = np.isin(target, seats)[:, None, None]
        alone = replace(
            own,
            pose_columns=pose_columns,
            target_columns=np.where(shifting, own.target_columns, 0.0),
            free_targets=seats,
        )
        alike = np.sqrt(self._weight)[:, None, None] * np.eye(3)
        return Elimination(alone, alike, length_floor_mm=np.inf)

    def tried(self, chosen: I64, change: F64) -> F64:
        """Residuals (m, 3) mm of the readings left out after a change of the chosen unknowns.

        Their poses and seats are those that the other readings tell, where these do: a seat lies
        where it lies in the artefact, whatever stands in the fold.
        """
        own = self._base.rows(self._out)
        moved = self._columns[:, :, chosen] @ change
        twist, shift = self._training.back_substitute(moved[~self._out])
        residual = own.residual_mm + moved[self._out]
        residual += np.einsum("nij,nj->ni", own.target_columns, shift[own.observations.target])
        residual += np.einsum("nij,nj->ni", own.pose_columns, twist[own.observations.placement])
        if self._trial is None:
            return residual
        twist, shift = self._trial.back_substitute(residual - own.residual_mm)
        at = self._trial.at
        residual += np.einsum("nij,nj->ni", at.pose_columns, twist[own.observations.placement])
        residual += np.einsum("nij,nj->ni", at.target_columns, shift[own.observations.target])
        return residual


def placement_folds(observations: Observations) -> tuple[list[Mask], str]:
    """Sets of whole placements to leave out, and by what they are told apart.

    With one placement only, every eighth reading is left out instead, at the pose that the others
    tell: weaker, and said so.
    """
    fold, by = whole_groups(observations.placement, MOST_FOLDS), "placement"
    if not fold.any():
        fold, by = np.arange(observations.n) % MOST_FOLDS, "reading"
    return [fold == i for i in np.unique(fold)], by

"""Compute errors on held-out readings: placements or temperatures, one set at a time.

Around the solution the model is linear far beyond the noise, so a fit without some readings is one
small linear problem. For the held-out readings only the placements are fitted, and seats that no
other reading touched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import stdtrit

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.linear.solution import Solution
from armd.compensation.estimate.linearise import Linearisation
from armd.compensation.estimate.noise.reading import make_whitening
from armd.compensation.estimate.noise.robust import compute_redescending_weights
from armd.compensation.estimate.observations import Observations
from armd.compensation.identify.arm_alone import ArmAlone
from armd.compensation.identify.fit import Identification, compute_rms_um

#: With this many sets, the error of a next one is estimated; it stays below in this share of cases.
LEAST_SETS, ANOTHER = 3, 0.95
#: A smaller error counts as none.
LEAST_UM = 1e-3


class HeldOut:
    """A linear model around a fit, fitted without the readings of a fold and tested on these.

    *columns* (n, 3, C) mm and *scale* (C,): all unknowns that any of the compared models uses.
    *residual* (n, 3) mm: with all these unknowns at their start. *pull* (C,): from the start to the
    nominal values, which are kept where a fold's other readings determine nothing.
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
        weight = fit.counts * compute_redescending_weights(fit.distance2, fit.region)
        turned = fit.observations.turned
        whiten = make_whitening(fit.noise.covariance(fit.linearisation.joints, turned), weight)
        self.scale, self.pull = scale, pull
        base = replace(fit.linearisation, residual_mm=residual)
        self._full_problem = full_problem = ArmAlone(base, whiten, columns)
        self.folds = [_Fold(full_problem, weight, out) for out in folds if out.any()]
        self._points = [~turned[out] for out in folds if out.any()]
        self._is_full_weight = [
            ~np.isin(np.flatnonzero(out), fit.down_weighted) for out in folds if out.any()
        ]

    def solve(self, fold: int, chosen: I64) -> Solution:
        """Solve for the chosen unknowns' changes (len(chosen),) without the fold."""
        training = self.folds[fold].training
        return training.solve(self.scale[chosen], self.pull[chosen], chosen=chosen)

    def solve_all(self, chosen: I64) -> Solution:
        """Solve for the chosen unknowns' changes with all readings."""
        return self._full_problem.solve(self.scale[chosen], self.pull[chosen], chosen=chosen)

    def errors(self, chosen: I64) -> Errors:
        """Compute the errors on each fold of fits of *chosen* without it."""
        changes = [self.solve(i, chosen).step for i in range(len(self.folds))]
        return self.summarise(self.try_changes(chosen, changes))

    def try_changes(self, chosen: I64, changes: Sequence[F64]) -> list[F64]:
        """Return each fold's residuals (m, 3) mm after its change of the chosen unknowns."""
        columns = self._full_problem.columns
        steps = np.zeros((len(changes), columns.shape[2]))
        steps[:, chosen] = changes
        # All folds at once: copying a fold's columns for each tried model takes longer.
        moved = (columns.reshape(-1, columns.shape[2]) @ steps.T).reshape(*columns.shape[:2], -1)
        return [
            fold.compute_residual_mm(step, moved[:, :, i])
            for i, (fold, step) in enumerate(zip(self.folds, steps, strict=True))
        ]

    def summarise(self, tried: Sequence[F64]) -> Errors:
        """Summarise residuals (m, 3) mm of each fold."""
        # The miss of an orientation is no distance.
        tried = [
            residual_mm[points] for residual_mm, points in zip(tried, self._points, strict=True)
        ]
        fine_rows = [
            k[points] for k, points in zip(self._is_full_weight, self._points, strict=True)
        ]
        residual, is_full_weight = np.concatenate(tried), np.concatenate(fine_rows)
        sets = tuple(
            compute_rms_um(residual_mm[fine] if fine.any() else residual_mm)
            for residual_mm, fine in zip(tried, fine_rows, strict=True)
        )
        return Errors(
            compute_rms_um(residual),
            compute_rms_um(residual[is_full_weight]),
            int((~is_full_weight).sum()),
            sets,
        )


@dataclass(frozen=True)
class Errors:
    """The 3-D RMS of all held-out readings, and without the down-weighted ones."""

    rms_um: float
    without_down_weighted_um: float
    n_down_weighted: int
    of_sets_um: tuple[float, ...] = ()  # of each set alone, without down-weighted readings

    @property
    def of_another_um(self) -> float:
        """The limit that a further set stays below in 95 of 100 cases, by the spread of these.

        The logarithms are taken as normal, so k of them give Student's t with k − 1 degrees of
        freedom. NaN for fewer than three sets.
        """
        k = len(self.of_sets_um)
        if k < LEAST_SETS:
            return np.nan
        logs = np.log(np.maximum(self.of_sets_um, LEAST_UM))
        spread = float(stdtrit(k - 1, ANOTHER)) * float(logs.std(ddof=1)) * np.sqrt(1.0 + 1.0 / k)
        return max(float(np.exp(logs.mean() + spread)), self.without_down_weighted_um)

    def in_words(self) -> str:
        """Return both figures in one line, or one if no reading is down-weighted."""
        if not self.n_down_weighted:
            return f"{self.rms_um:.2f} µm"
        without = f"{self.without_down_weighted_um:.2f} without the {self.n_down_weighted}"
        return f"{self.rms_um:.2f} µm ({without} down-weighted)"


def compute_another_placement_um(
    observations: Observations, errors: Errors, left_out_by: str
) -> float | None:
    """Return the 3-D RMS that another placement stays below in 95 of 100 cases.

    None where several placements are held out together: then there are enough for the mean.
    """
    is_each_placement = len(np.unique(observations.placement)) == len(errors.of_sets_um)
    another = errors.of_another_um if left_out_by == "placement" and is_each_placement else np.nan
    return another if np.isfinite(another) else None


def describe_held_out(observations: Observations, errors: Errors, left_out_by: str) -> str:
    """Return what a held-out set consists of: `each placement`, `every 8th reading`."""
    if left_out_by == "placement":
        groups = len(np.unique(observations.placement))
    else:
        groups = observations.n_postures
    sets = len(errors.of_sets_um)
    if left_out_by == "temperature" or groups <= sets:
        return f"each {left_out_by}"
    return f"every {sets}th {left_out_by}"


class _Fold:
    """One held-out set of readings; the unknowns of *full_problem* are at their start."""

    def __init__(self, full_problem: ArmAlone, weight: F64, out: Mask) -> None:
        base, columns = full_problem.linearisation, full_problem.columns
        self._base, self._out = base, out
        self._weight = weight[out]  # an outlier does not move its placement
        observations = base.observations
        touched = observations.target[~out & ~observations.has_truth]
        free = base.free_targets[np.isin(base.free_targets, touched)]
        # Held-out rows get no weight: a copy of all other columns for each fold would be large.
        whiten = np.where(out[:, None, None], 0.0, full_problem.whitening)
        linearisation = replace(base, free_targets=free)
        self.training = ArmAlone(linearisation, whiten, columns, full_problem=full_problem)

    @cached_property
    def _linearisation(self) -> Linearisation:
        """The linearisation of the held-out readings, without unused derivatives."""
        return replace(self._base, jacobian=self._base.jacobian[:, :, :0]).rows(self._out)

    @cached_property
    def _trial(self) -> ArmAlone | None:
        """The problem fitted to held-out readings: poses and seats that no other reading
        determines.

        None where other readings determine all poses.
        """
        linearisation = self._linearisation
        placement, target = linearisation.observations.placement, linearisation.observations.target
        has_pose = np.isin(placement, self._base.observations.placement[~self._out])
        if has_pose.all():
            return None
        pose_columns = np.where(has_pose[:, None, None], 0.0, linearisation.pose_columns)
        seats = np.setdiff1d(linearisation.free_targets, self.training.linearisation.free_targets)
        shifting = np.isin(target, seats)[:, None, None]
        trial_linearisation = replace(
            linearisation,
            pose_columns=pose_columns,
            target_columns=np.where(shifting, linearisation.target_columns, 0.0),
            free_targets=seats,
        )
        alike = np.sqrt(self._weight)[:, None, None] * np.eye(3)
        return ArmAlone(
            trial_linearisation, alike, trial_linearisation.jacobian, length_floor_mm=np.inf
        )

    def compute_residual_mm(self, step: F64, moved_mm: F64) -> F64:
        """Compute the residuals (m, 3) mm of the held-out readings after a *step* (C,).

        The step moved all readings by *moved_mm* (n, 3). Poses and seats come from the other
        readings where these determine them: a seat has one place in the artefact, in the fold as
        outside.
        """
        linearisation = self._linearisation
        residual = linearisation.residual_mm + moved_mm[self._out]
        sessions = np.unique(linearisation.observations.session)
        residual = _add_answers(residual, linearisation, *self.training.follow(step, sessions))
        if self._trial is None:
            return residual
        trial_linearisation = self._trial.linearisation
        moved_problem = replace(
            self._trial, linearisation=replace(trial_linearisation, residual_mm=residual)
        )
        return _add_answers(residual, trial_linearisation, *moved_problem.follow(np.zeros(0)))


def _add_answers(residual_mm: F64, linearisation: Linearisation, twist: F64, shift: F64) -> F64:
    """Add twists (p, 6) of placements and shifts (K, 3) of targets to residuals (n, 3)."""
    observations = linearisation.observations
    shifted = np.einsum("nij,nj->ni", linearisation.target_columns, shift[observations.target])
    turned = np.einsum("nij,nj->ni", linearisation.pose_columns, twist[observations.placement])
    answered: F64 = residual_mm + shifted + turned
    return answered

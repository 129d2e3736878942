"""The model around a point: residuals, parameter Jacobian, and what only nuisances explain.

Calibration and diagnosis stand on this one. Nuisances are the placements (six columns each) and
the targets nobody certified exactly (three columns each). A calibration steps towards its answer,
so its columns are taken at adjusted angles; a diagnosis asks what an answer leaves, at the angles
as read (docs/decisions/0023).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.adjustment import adjust_angles
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.orientations import compute_observed, compute_turn_columns
from armd.compensation.estimate.placements.fit_poses import fit_steady_poses
from armd.compensation.estimate.placements.poses import (
    Poses,
    compute_centres,
    make_pose_columns,
    make_target_columns,
)
from armd.compensation.estimate.surfaces import project_on_normals
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.kinematics import compute_jacobian
from armd.compensation.model.terms import Term


@dataclass(frozen=True, kw_only=True)
class Linearisation:
    """Residuals (n, 3) mm in the base frame, tip minus target, and how they move.

    With parameter changes δ (per row: constants' plus coefficient × basis value), twists w of the
    placements and shifts s of the targets:
    residual + jacobian·δ + pose_columns·w[placement] + target_columns·s[target]. Of a reading on a
    surface all of them lie along its normal.
    """

    observations: Observations
    poses: Poses
    position_mm: F64  # (n, 3) tip, base frame
    residual_mm: F64  # (n, 3)
    q: F64  # (n, N) rad, the angles at which columns are taken: adjusted or as read
    there_mm: F64  # (n, 3) tip at these angles, base frame
    jacobian: F64  # (n, 3, P) d residual / d parameter, at these angles
    basis: F64  # (n, T) values of the terms' basis functions
    centre_mm: F64  # (p, 3) what the placements' twists turn about
    pose_columns: F64  # (n, 3, 6)
    target_columns: F64  # (n, 3, 3); zero where the row's own truth counts
    free_targets: I64  # targets that move: unknown seats, and positions with an uncertainty

    def rows(self, mask: Mask) -> Linearisation:
        """The same linearisation with some readings only."""
        return replace(
            self,
            observations=(chosen := self.observations.rows(mask)),
            position_mm=self.position_mm[mask],
            residual_mm=self.residual_mm[mask],
            q=self.q[mask],
            there_mm=self.there_mm[mask],
            jacobian=self.jacobian[mask],
            basis=self.basis[mask],
            pose_columns=self.pose_columns[mask],
            target_columns=self.target_columns[mask],
            free_targets=_find_free_targets(chosen),
        )

    @cached_property
    def joints(self) -> F64:
        """d tip / d angle (n, 3, N) mm/rad, in one piece of memory: much is multiplied by it."""
        return np.ascontiguousarray(self.jacobian[:, :, self.observations.arm.layout.angles])

    def make_constant_columns(self, names: Sequence[str]) -> F64:
        """d residual / d constant (n, 3, len(names))."""
        indices = np.array(self.observations.arm.layout.indices(names), dtype=np.int64)
        columns: F64 = np.take(self.jacobian, indices, axis=2)
        return columns

    def make_term_columns(self, terms: Sequence[Term], basis: F64) -> F64:
        """d residual / d coefficient (n, 3, T): the parameter's column times the basis (n, T)."""
        columns = self.make_constant_columns([term.parameter for term in terms])
        columns *= basis[:, None, :]
        return columns


def linearise(
    observations: Observations,
    constants: F64,
    terms: Sequence[Term],
    poses: Poses,
    reference_c: float,
    basis: F64 | None = None,
) -> Linearisation:
    """Linearise about constants (P,) in mm and rad, the terms' coefficients, and *poses*.

    A row with a missing temperature that a term needs has NaN throughout; leave such rows out
    beforehand. *basis* (n, T): the terms' values, where already known.
    """
    states, arm = observations.states, observations.arm
    if basis is None:
        basis = compute_basis_values(terms, states, arm, reference_c, constants)
    rows = compute_parameter_rows(constants, terms, basis)
    turned = observations.turned
    position = compute_observed(states.q, rows, turned)
    placed = poses.place_tips(observations, position)
    q, points = states.q.copy(), ~turned
    q[points] = adjust_angles(states.q[points], rows[points], placed[points])
    adjusted_position, columns = compute_jacobian(q, rows)
    if turned.any():
        adjusted_position[turned] = position[turned]
        columns[turned] = compute_turn_columns(q[turned], rows[turned])
    return _linearise_around(
        observations, poses, position, (q, adjusted_position, columns), basis, placed
    )


def linearise_as_read(
    observations: Observations,
    constants: F64,
    terms: Sequence[Term],
    basis: F64,
    off_tip_mm: F64 | None = None,
) -> Linearisation:
    """The same where the readings put the tip, with poses and unknown seats fitted there: columns
    and levers at the angles as read. A monstrous reading does not move them. *off_tip_mm* (n, 3):
    how far from the tip, in the last frame, sits what each reading is of."""
    rows = compute_parameter_rows(constants, terms, basis)
    if off_tip_mm is not None:
        rows = rows.copy()
        rows[:, observations.arm.layout.tip] += off_tip_mm
    q, turned = observations.states.q, observations.turned
    position, columns = compute_jacobian(q, rows)
    if turned.any():
        position = compute_observed(q, rows, turned)
        columns[turned] = compute_turn_columns(q[turned], rows[turned])
    poses = fit_steady_poses(observations, position)
    columns_at = q, position, columns
    return _linearise_around(observations, poses, position, columns_at, basis, position)


def _linearise_around(
    observations: Observations,
    poses: Poses,
    position: F64,
    columns_at: tuple[F64, F64, F64],
    basis: F64,
    levers_to_mm: F64,
) -> Linearisation:
    q, column_position, columns = columns_at
    centre = compute_centres(observations, levers_to_mm)
    normal = poses.compute_normals(observations, position)
    return Linearisation(
        observations=observations,
        poses=poses,
        position_mm=position,
        residual_mm=poses.residual(observations, position),
        q=q,
        there_mm=column_position,
        jacobian=project_on_normals(normal, columns),
        basis=basis,
        centre_mm=centre,
        pose_columns=project_on_normals(
            normal, make_pose_columns(observations, levers_to_mm, centre)
        ),
        target_columns=make_target_columns(observations, poses, normal),
        free_targets=_find_free_targets(observations),
    )


def _find_free_targets(observations: Observations) -> I64:
    """Targets that readings without their own truth touch, and whose position may move."""
    touched = np.unique(observations.target[~observations.has_truth])
    movable = observations.unknown | (observations.uncertainty_mm > 0)
    return touched[movable[touched]]

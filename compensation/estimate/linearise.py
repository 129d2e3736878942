"""The model around a point: residuals, parameter Jacobian, and columns of nuisances.

Calibration and diagnosis both use it. Nuisances are the placements (six columns each) and the
targets whose position is not certified exactly (three columns each). A calibration steps towards
its solution, so its columns are taken at adjusted angles. A diagnosis examines the residuals of a
solution, at the angles as read (docs/decisions/0023).
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
    """Residuals (n, 3) mm in the base frame, tip minus target, and their derivatives.

    With parameter changes δ (per row: constants' plus coefficient × basis value), twists w of the
    placements and shifts s of the targets: residual + jacobian·δ + pose_columns·w[placement] +
    target_columns·s[target]. For a reading on a surface all of them lie along its normal.
    """

    observations: Observations
    poses: Poses
    position_mm: F64  # (n, 3) tip, base frame
    residual_mm: F64  # (n, 3)
    q: F64  # (n, N) rad, the angles at which columns are taken: adjusted or as read
    there_mm: F64  # (n, 3) tip at these angles, base frame
    jacobian: F64  # (n, 3, P) d residual / d parameter, at these angles
    basis: F64  # (n, T) values of the terms' basis functions
    centre_mm: F64  # (p, 3) centres about which the placements' twists turn
    pose_columns: F64  # (n, 3, 6)
    target_columns: F64  # (n, 3, 3); zero where the row has its own truth
    free_targets: I64  # targets that move: unknown seats, and positions with an uncertainty

    def rows(self, mask: Mask) -> Linearisation:
        """Return the linearisation with some readings only."""
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
        """The derivative d tip / d angle (n, 3, N) mm/rad, contiguous for fast products."""
        return np.ascontiguousarray(self.jacobian[:, :, self.observations.arm.layout.angles])

    def make_constant_columns(self, names: Sequence[str]) -> F64:
        """Return d residual / d constant (n, 3, len(names))."""
        indices = np.array(self.observations.arm.layout.indices(names), dtype=np.int64)
        columns: F64 = np.take(self.jacobian, indices, axis=2)
        return columns

    def make_term_columns(self, terms: Sequence[Term], basis: F64) -> F64:
        """Return d residual / d coefficient (n, 3, T): parameter's column × basis (n, T)."""
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

    A row with a missing temperature that a term needs has NaN throughout; drop such rows
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
    """Linearise at the angles as read, with poses and unknown seats fitted there.

    Columns and levers are taken at the tip's positions by these angles. A monstrous reading does
    not move the poses. *off_tip_mm* (n, 3): offset from the tip, in the last frame, of the point
    that each reading is of.
    """
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
    """Find the targets touched by readings without own truth whose position may move."""
    touched = np.unique(observations.target[~observations.has_truth])
    movable = observations.unknown | (observations.uncertainty_mm > 0)
    return touched[movable[touched]]

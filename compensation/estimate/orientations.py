"""Readings of the last frame's orientation, as rows beside those of the tip's position.

A row that is *turned* measures the orientation of a body on the last link. This body is turned
against the last frame by an unknown rotation. The residual is a rotation vector in the base frame,
times a lever that makes mm of it. So all else in the estimate treats it as a row like any other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.observations import TURN_MM, Observations
from armd.compensation.estimate.surface_kinds import TURN
from armd.compensation.model.kinematics import compute_jacobian, compute_pose
from armd.compensation.model.parameters import ParameterLayout


def add_orientations(observations: Observations) -> Observations:
    """Append a row for each reading that has an orientation, after all others."""
    measured = find_oriented_rows(observations)
    if not len(measured):
        return observations
    n, sessions = observations.n, np.unique(observations.session[measured])
    session_number = np.searchsorted(sessions, observations.session[measured])
    all_rows = observations.rows(np.concatenate([np.arange(n), measured]))
    behind = np.arange(n, n + len(measured))
    target, truth = all_rows.target.copy(), all_rows.truth_mm.copy()
    target[behind], truth[behind] = len(observations.target_names) + session_number, np.nan
    names = [f"{observations.session_names[s]}/orientation" for s in sessions.tolist()]
    turned = np.arange(all_rows.n) >= n
    k = len(sessions)
    return replace(
        all_rows,
        target=target,
        truth_mm=truth,
        turned=turned,
        target_names=[*observations.target_names, *names],
        kind=np.append(observations.kind, np.full(k, TURN)),
        position_mm=np.vstack([observations.position_mm, np.full((k, 3), np.nan)]),
        uncertainty_mm=np.append(observations.uncertainty_mm, np.zeros(k)),
        certificate=np.append(
            observations.certificate, observations.certificate.max(initial=0) + 1 + np.arange(k)
        ),
        target_session=np.append(observations.target_session, sessions),
    )


def add_orientation_rows(observations: Observations, rows: Mask) -> Mask:
    """Return the mask of the chosen *rows* (n,) and of their orientations after all others."""
    return np.append(rows, rows[find_oriented_rows(observations)])


def find_oriented_rows(observations: Observations) -> I64:
    """Find the rows that have an orientation."""
    return np.flatnonzero(np.isfinite(observations.measured_turn[:, 0, 0]))


def compute_observed(q: F64, rows: F64, turned: Mask) -> F64:
    """Return the modelled readings (n, 3) mm, base frame, by angles (n, N) and parameters (n, P).

    They are the tip's position or, for *turned* rows (n,), the last frame's rotation vector times
    its lever.
    """
    position, rotation = compute_pose(q, rows)
    if turned.any():
        position = position.copy()
        position[turned] = TURN_MM * Rotation.from_matrix(rotation[turned]).as_rotvec()
    return position


def compute_turn_columns(q: F64, rows: F64) -> F64:
    """Return d rotation vector / d parameter (n, 3, P) of the last frame, base frame, at the lever.

    It is computed from the motions of the tips of the frame's three unit vectors.
    """
    tip_columns = ParameterLayout.from_count(rows.shape[1]).tip
    without = rows.copy()
    without[:, tip_columns] = 0.0
    origin, columns = compute_jacobian(q, without)
    turned = np.zeros_like(columns)
    for axis in np.eye(3):
        without[:, tip_columns] = axis
        end, moved = compute_jacobian(q, without)
        turned += 0.5 * np.cross((end - origin)[:, :, None], moved - columns, axis=1)
    turned[:, :, tip_columns] = 0.0
    scaled: F64 = TURN_MM * turned
    return scaled

"""Columns of errors that rests share: errors of certified positions, and a drifting base."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import KNOT_S, LEAST_DRIFT_ROWS, MOST_KNOTS
from armd.compensation.diagnose.problem.linear import Linear
from armd.compensation.estimate.linear.blocks import Blocks, Piece
from armd.compensation.estimate.surfaces import project_on_normals


def make_target_nuisance(linear: Linear) -> tuple[F64, F64]:
    """Return three columns (N, …) for each certified target, and their variances.

    They are the error within the certificate's uncertainty, shared by the target's rests.
    """
    observations = linear.rests.observations
    uncertainty = observations.uncertainty_mm
    labels = np.array(linear.rests.target_label)
    certified = (uncertainty > 0) & ~observations.unknown
    used = np.zeros(len(labels), dtype=bool)
    used[observations.target[~observations.has_truth]] = True
    columns, variance = [], []
    rotation = linear.poses.rotation[observations.placement]
    for label in dict.fromkeys(labels[certified & used]):
        rows = (labels[observations.target] == label) & ~observations.has_truth
        sigma = float(uncertainty[labels == label].max())
        for axis in range(3):
            column = np.zeros(len(linear.residual))
            moves = rotation[:, :, axis]
            if linear.normal is not None:  # the third coordinate of a surface: height or radius
                of_surface = linear.normal * float(axis == 2)
                moves = np.where(observations.on_surface[:, None], of_surface, moves)
            column[: 3 * linear.rests.n] = (moves * rows[:, None]).ravel()
            columns.append(column)
            variance.append(sigma**2)
    stacked = np.stack(columns, axis=1) if columns else np.zeros((len(linear.residual), 0))
    return stacked, np.array(variance)


def make_drift_columns(linear: Linear) -> tuple[Blocks, F64]:
    """Return columns of a drifting base: a random walk in each session, three directions each.

    The variances are NaN, for the noise estimate to fill in.

    Each column rises linearly from the knot before its own and then stays. With independent steps,
    slow changes are large and quick ones small, as in a real stand. With independent heights at the
    knots, slow changes would remain and be reported as causes.
    """
    observations = linear.rests.observations
    piece_of: dict[int, Piece] = {}
    count = 0
    for session in np.unique(observations.session):
        rows = np.flatnonzero(observations.session == session)
        time = observations.states.time_s[rows]
        span = float(np.ptp(time))
        if len(rows) < LEAST_DRIFT_ROWS or not span > 0:  # NaN: no times
            continue
        knots = np.linspace(time.min(), time.max(), min(MOST_KNOTS, 2 + int(span / KNOT_S)))
        ramps = np.clip(1.0 + (time[:, None] - knots) / (knots[1] - knots[0]), 0.0, 1.0)
        for placement in np.unique(observations.placement[rows]):
            members = np.flatnonzero(observations.placement[rows] == placement)
            reached = ramps[members][:, ramps[members].any(axis=0)]  # knots reached so far
            values = np.einsum("kj,ab->kajb", reached, np.eye(3)).reshape(len(members), 3, -1)
            values[observations.turned[rows[members]]] = 0.0  # a shift of the base turns nothing
            if linear.normal is not None:
                values = project_on_normals(linear.normal[rows[members]], values)
            numbers = count + np.arange(values.shape[2])
            piece_of[int(placement)] = Piece(rows[members], numbers, values)
        count += 3 * len(knots)
    pieces = []
    for placement in np.unique(observations.placement):
        rests = np.flatnonzero(observations.placement == placement)
        none = Piece(rests, np.empty(0, dtype=np.int64), np.empty((len(rests), 3, 0)))
        pieces.append(piece_of.get(int(placement), none))
    distances = np.zeros((len(linear.residual) - 3 * linear.rests.n, count))
    return Blocks(linear.rests.n, count, tuple(pieces), distances), np.full(count, np.nan)

"""Many harmonics of one joint's angle as the curve that a calibration file contains.

Where the joint never stood nothing is known. The curve is its own mean there, not the arbitrary sum
of the harmonics.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.diagnose.constants import CURVE_POINTS, SEEN_POINTS
from armd.compensation.diagnose.problem.amplitudes import is_curve
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.effects.effect import Candidate, Column
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.model.pose_factors import Curve, Harmonic
from armd.compensation.model.terms import Term

TURN = np.linspace(0.0, 2 * np.pi, CURVE_POINTS, endpoint=False)


def as_curve(candidate: Candidate, values: F64, q: F64) -> Term:
    """Return one factor for the live path; *q* (n, N): angles at which it was learnt."""
    heights = np.zeros(CURVE_POINTS)
    joint, parameter = 1, ""
    for column, value in zip(candidate.columns, values, strict=True):
        joint, parameter, wave = _wave(column)
        heights += float(value) * wave
    visited = _visited_points(q[:, joint - 1])
    heights[~visited] = heights[visited].mean()
    return Term(
        parameter=parameter,
        basis=[Curve(joint=joint, values=heights.tolist())],
        coefficient=1.0,
        effect=f"{candidate.cause} {candidate.location}",
    )


def list_unknown_columns(current: Fit, out: Mask) -> Iterator[tuple[slice, I64, F64]]:
    """Yield for each curve among the findings its columns where the written curve is unknown.

    These are its nuisance columns (m,), the rows (r,) of those rests *out* at which a curve learnt
    from the other rests knows nothing, and the columns' values (r, m) there: the curve's mean.
    """
    linear = current.linear
    q = linear.rests.observations.states.q
    for candidate, span in zip(current.findings, current.layout.findings, strict=True):
        if not is_curve(candidate):
            continue
        waves = [_wave(column) for column in candidate.columns]
        joint, parameter, _ = waves[0]
        visited = _visited_points(q[~out, joint - 1])
        strange = np.flatnonzero(out & ~visited[_nearest(q[:, joint - 1])])
        rows = (3 * strange[:, None] + np.arange(3)).ravel()
        index = ParameterLayout(q.shape[1]).index(parameter)
        means = np.array([wave[visited].mean() for _, _, wave in waves])
        yield span, rows, linear.jacobian[index, rows][:, None] * means


def list_orders(candidate: Candidate) -> list[int]:
    """Return the orders of a curve's harmonics, ascending."""
    return sorted({factor.order for factor in candidate.factors if isinstance(factor, Harmonic)})


def _wave(column: Column) -> tuple[int, str, F64]:
    """Return joint, parameter, and a harmonic's column over the turn (CURVE_POINTS,)."""
    (term,) = column.terms
    factor = term.basis[0]
    assert isinstance(factor, Harmonic)
    wave = np.sin if factor.kind == "sin" else np.cos
    return factor.joint, term.parameter, term.coefficient * wave(factor.order * TURN)


def _nearest(angle: F64) -> I64:
    """Return the points of the curve (n,) nearest to angles."""
    nearest: I64 = np.round(angle / (2 * np.pi / CURVE_POINTS)).astype(np.int64) % CURVE_POINTS
    return nearest


def _visited_points(angle: F64) -> Mask:
    """Return the points of the curve near which a joint stood."""
    nearest = _nearest(angle)
    visited = np.zeros(CURVE_POINTS, dtype=bool)
    for shift in range(-SEEN_POINTS, SEEN_POINTS + 1):
        visited[(nearest + shift) % CURVE_POINTS] = True
    return visited

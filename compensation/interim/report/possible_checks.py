"""Possible checks: seats at places that a person can reach, and poses of the arm on each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from armd.arrays import F64, I64
from armd.compensation.design.clearance import compute_column_distance_mm, compute_height_mm
from armd.compensation.estimate.adjustment import adjust_angles
from armd.compensation.interim.checks.catalogue_digest import hash_catalogue
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.checks.open_growth import list_open_growth
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.checks.signals import Signals
from armd.compensation.interim.report.reach import draw_poses
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.state import States

#: The number of seats that are tried, of random poses for each, and of poses that are kept for
#: each.
SEATS, DRAWN, POOL = 12, 480, 24
#: A seat is on the table or on something on it: its height over the base, and its distance from the
#: column, as shares of the arm's reach.
HEIGHT, AWAY = (0.0, 0.5), (0.2, 0.8)
#: Distance kept from every end stop, rad.
MARGIN_RAD = np.radians(2.0)
#: Iterations to reach a seat, and the largest distance from it that is accepted, mm.
STEPS, THERE_MM = 25, 0.5


@dataclass(frozen=True)
class PossibleCheck:
    """Possible poses on seats, the same number on each seat."""

    seats_mm: F64  # (S, 3) base frame
    states: States  # S × `POOL`, seat by seat

    def list_poses_on(self, seat: int) -> I64:
        return seat * POOL + np.arange(POOL)


def plan_check(arm: Arm, calibration: Calibration, at_unix_s: float) -> PossibleCheck:
    """List seats that the arm reaches in enough poses with no part of it below its base."""
    constants = calibration.vector(arm.n_joints)
    drawn = draw_poses(arm, calibration.reference_temperature_c, DRAWN, 21)
    drawn = replace(drawn, time_s=np.full(drawn.n, at_unix_s))
    tips = compute_pose(drawn.q, np.tile(constants, (drawn.n, 1)))[0]
    away = compute_column_distance_mm(drawn.q, constants)
    reach = float(away.max())
    height = tips @ -np.array(arm.gravity) / np.linalg.norm(arm.gravity)
    free = (away > AWAY[0] * reach) & (away < AWAY[1] * reach)
    free &= (height > HEIGHT[0] * reach) & (height < HEIGHT[1] * reach)
    seats, on_seats = [], []
    for seat in tips[free][:SEATS]:
        on_seat = _reach_seat(arm, constants, seat, drawn)
        if on_seat.n >= POOL:
            seats.append(seat)
            on_seats.append(on_seat.rows(slice(POOL)))
    return PossibleCheck(
        np.array(seats).reshape(-1, 3), States.joined(on_seats) if seats else drawn.rows(slice(0))
    )


def _reach_seat(arm: Arm, constants: F64, seat: F64, drawn: States) -> States:
    """Compute different poses with the tip on *seat* (3,)."""
    parameters = np.tile(constants, (drawn.n, 1))
    q = drawn.q
    for _ in range(STEPS):
        q = adjust_angles(q, parameters, np.tile(seat, (drawn.n, 1)))
    is_on_seat = np.linalg.norm(compute_pose(q, parameters)[0] - seat, axis=1) < THERE_MM
    low, high = arm.limits_rad
    inside = ((q > low + MARGIN_RAD) & (q < high - MARGIN_RAD)).all(axis=1)
    good = np.flatnonzero(is_on_seat & inside & (compute_height_mm(q, constants, arm) >= 0.0))
    return replace(drawn, q=q).rows(good)


def predict_check(
    plan: PossibleCheck, arm: Arm, calibration: Calibration, causes: Sequence[Cause]
) -> Reduced:
    """Predict the reduction of a check of all these poses, three rows for each.

    Its seats are not projected out.
    """
    signals = Signals(plan.states, arm, calibration)
    whitener = signals.compute_whitener()
    columns = [column for cause in causes for column in cause.candidate.columns]

    def rows(motions: F64) -> F64:
        return (whitener @ motions).reshape(3 * plan.states.n, -1)

    growth = list_open_growth(arm, calibration)
    error_columns = rows(
        np.concatenate(
            [signals.compute_calibration_motions(), signals.compute_growth_motions(growth)], axis=2
        )
    )
    instant_s = float(plan.states.time_s[0])
    count = len(plan.seats_mm)
    return Reduced(
        residual=np.zeros(3 * plan.states.n),
        causes=rows(signals.compute_motions(columns)),
        error_columns=error_columns,
        known_names=(
            *(f"calibrated {i}" for i in range(error_columns.shape[1] - len(growth))),
            *(expansion.name for expansion in growth),
        ),
        targets=block_diag(*whitener.reshape(count, -1, 3)),
        target_names=tuple(f"seat {i}" for i in range(count)),
        certified=(False,) * count,
        mean_unix_s=instant_s,
        first_unix_s=instant_s,
        last_unix_s=instant_s,
        readings=plan.states.n,
        rms_um=0.0,
        catalogue=hash_catalogue(causes, growth),
    )


def select_rows(check: Reduced, chosen: I64) -> Reduced:
    """Select some of a check's numbers."""
    return replace(
        check,
        residual=check.residual[chosen],
        causes=check.causes[chosen],
        error_columns=check.error_columns[chosen],
        targets=check.targets[chosen],
    )

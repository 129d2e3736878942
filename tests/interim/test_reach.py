"""How far a change moves the tip, and checks that an arm can make."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armd.compensation.effects.effect import Candidate, Column, tie
from armd.compensation.effects.location import joint
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.checks.signals import Signals
from armd.compensation.interim.report.possible_checks import (
    POOL,
    THERE_MM,
    plan_check,
    predict_check,
    select_rows,
)
from armd.compensation.interim.report.reach import compute_tip_rms_um, draw_poses
from support import synthetic
from support.drawn import drawn
from support.plain_kinematics import tip_pose

ARM = synthetic.arm()
CALIBRATION = drawn(ARM)
NAMES = ARM.layout.names


def of(name: str, unit: str = "mm") -> Candidate:
    return Candidate("geometry_shift", joint(3), (Column("x", unit, 1.0, tie([(name, 1.0)])),), ())


def plain_tips(q: np.ndarray, **off: float) -> np.ndarray:
    p = np.tile(CALIBRATION.vector(ARM.n_joints), (len(q), 1))
    for name, by in off.items():
        p[:, NAMES.index(name)] += by
    return tip_pose(q, p)[:, :3, 3]


@pytest.mark.parametrize("name", ["base_x", "base_rz", "theta_1", "d_1"])
def test_what_moves_everything_alike_is_no_change_of_the_arm(name: str) -> None:
    """Joint 1 stands on the base's axis: its zero and its height are the base's."""
    assert compute_tip_rms_um(ARM, CALIBRATION, of(name), np.array([1e-3])) < 1e-3


def test_the_figure_is_what_a_plain_fit_over_the_same_poses_leaves() -> None:
    at = draw_poses(ARM, 20.0, 400, 20)
    here, there = plain_tips(at.q), plain_tips(at.q, a_4=0.05)
    turn, _ = Rotation.align_vectors(here - here.mean(axis=0), there - there.mean(axis=0))
    left = turn.apply(there - there.mean(axis=0)) - (here - here.mean(axis=0))
    expected = 1e3 * np.sqrt((left**2).sum(axis=1).mean())
    found = compute_tip_rms_um(ARM, CALIBRATION, of("a_4"), np.array([0.05]))
    assert found == pytest.approx(expected, rel=1e-3)


def test_poses_cover_the_ranges_and_come_from_either_side() -> None:
    at = draw_poses(ARM, 20.0, 2000, 3)
    low, high = ARM.range_rad
    assert (at.q >= low).all() and (at.q <= high).all()
    span = (at.q.max(axis=0) - at.q.min(axis=0)) / (high - low)
    assert (span > 0.98).all()
    assert np.linalg.norm(at.approach, axis=1) == pytest.approx(1.0)
    assert (np.abs(np.sign(at.rate).mean(axis=0)) < 0.1).all()


def test_planned_seats_are_reached_above_the_table_in_different_poses() -> None:
    plan = plan_check(ARM, CALIBRATION, 1.77e9)
    assert len(plan.seats_mm) >= 2 and plan.states.n == len(plan.seats_mm) * POOL
    low, high = ARM.limits_rad
    for i, seat in enumerate(plan.seats_mm):
        q = plan.states.q[plan.list_poses_on(i)]
        assert np.linalg.norm(plain_tips(q) - seat, axis=1).max() < THERE_MM
        assert ((q > low) & (q < high)).all()
        assert np.ptp(q, axis=0).max() > 0.5  # rad
        assert seat[2] > 0.0  # the base stands upright
    assert (plan.states.time_s == 1.77e9).all()


def test_a_planned_check_sees_what_its_poses_see() -> None:
    plan = plan_check(ARM, CALIBRATION, 1.77e9)
    causes = [Cause(of("a_4"), 1.0, 0.0)]
    check = predict_check(plan, ARM, CALIBRATION, causes)
    seen = Signals(plan.states, ARM, CALIBRATION)
    moved = (plain_tips(plan.states.q, a_4=1e-3) - plain_tips(plan.states.q, a_4=-1e-3)) / 2e-3
    expected = (seen.compute_whitener() @ moved[:, :, None]).ravel()
    assert check.causes[:, 0] == pytest.approx(expected, rel=1e-5, abs=1e-4)
    # A seat's shift moves all poses on it, and no others.
    own = 3 * plan.list_poses_on(1)[:, None] + np.arange(3)
    one = check.targets[:, 3:6]
    assert np.abs(one[own.ravel()]).max() > 0.0
    assert np.abs(np.delete(one, own.ravel(), axis=0)).max() == 0.0
    some = select_rows(check, own.ravel())
    assert some.causes == pytest.approx(check.causes[own.ravel()])
    assert len(some.residual) == 3 * POOL

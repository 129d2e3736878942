"""A joint that reads where no joint can be: no point, an event, a reason."""

from __future__ import annotations

import numpy as np
import pytest

from armd import Flag
from armd.daemon.config import Limits
from armd.daemon.live.end_stops import BACK_AFTER_NS, EndStopWatch
from armd.daemon.live.pipeline import Pipeline
from support.small_arm import samples_of, small_arm

LOW, HIGH = -100.0, 90.0


def limited_arm(low=LOW, high=HIGH):
    arm = small_arm()
    joints = [joint.model_copy(update={"min_deg": low, "max_deg": high}) for joint in arm.joint]
    return arm.model_copy(update={"joint": joints})


def points_at(arm, angle_deg):
    """Joint 2 at that angle, the others in the middle."""
    pipeline = Pipeline(arm, None, Limits())
    pose = np.zeros((1, 3))
    pose[0, 1] = angle_deg
    points, _ = pipeline.correct(samples_of(pose))
    return points, pipeline.take_beyond_stops(), pipeline


def test_near_its_end_stop_or_where_the_turn_is_not_known_or_no_limit_a_joint_is_valid():
    cases = [(limited_arm(), angle) for angle in (LOW - 5.0, LOW + 1.0, 0.0, HIGH + 9.5)]
    cases += [(arm, 179.0) for arm in (limited_arm(-400.0, 400.0), limited_arm(None, None))]
    for arm, angle_deg in [*cases, (small_arm(), 179.0)]:
        points, beyond, _ = points_at(arm, angle_deg)
        assert not points["flags"][0] & Flag.INVALID and beyond == {}, angle_deg


@pytest.mark.parametrize("angle_deg", [LOW - 11.0, HIGH + 11.0, 170.0, -170.0])
def test_far_beyond_it_no_point_leaves(angle_deg):
    points, beyond, pipeline = points_at(limited_arm(), angle_deg)
    assert points["flags"][0] & Flag.INVALID and np.isnan(points["position_mm"]).all()
    assert list(beyond) == [2]
    away = (beyond[2] - angle_deg + 180.0) % 360.0 - 180.0
    assert abs(away) < 1e-3  # of a turn, as the turn is not known
    assert pipeline.take_beyond_stops() == {}


def test_it_is_told_once_and_taken_back():
    watch = EndStopWatch(limited_arm())
    (event,) = watch.look({2: -170.0}, 0)
    assert event.kind == "beyond_end_stop" and event.severity == "error"
    assert "joint 2: found -170.0°, 70° beyond its end stop at -100°" in event.text
    assert watch.hindrance == event.text
    assert watch.look({2: -171.0}, BACK_AFTER_NS // 2) == []
    assert watch.look({}, BACK_AFTER_NS) == []
    (event,) = watch.look({}, 2 * BACK_AFTER_NS)
    assert event.kind == "joint_valid" and watch.hindrance == ""

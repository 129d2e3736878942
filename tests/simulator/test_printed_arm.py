"""The printed arm: without its faults it is the drawing, and each fault does what physics says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.effects.catalogue import _coarseness
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.catalogue.known_arms import load_known_arm
from armd.simulator.printed import bench
from armd.simulator.printed.arm import COUNTS_PER_TURN, TIP_MM, PrintedArm

COLD = np.full(5, 20.0)


@pytest.fixture
def perfect() -> PrintedArm:
    drawn = PrintedArm.draw(np.random.default_rng(1))
    zero = np.zeros_like
    return replace(
        drawn, shift_mm=zero(drawn.shift_mm), tilt_rad=zero(drawn.tilt_rad), tip_mm=TIP_MM,
        horn_rad=zero(drawn.horn_rad), eccentricity=zero(drawn.eccentricity),
        second_rad=zero(drawn.second_rad), stiffness_nm=np.full(5, 1e12),
        play_rad=zero(drawn.play_rad),
    )  # fmt: skip


def test_without_faults_it_is_the_drawing(perfect: PrintedArm) -> None:
    arm = load_known_arm("so101")
    directions = np.array([joint.direction for joint in arm.joint])
    rng = np.random.default_rng(2)
    for angles in rng.uniform(-1.5, 1.5, (20, 5)):
        counts = perfect.counts(angles, rng) * directions
        ours = compute_pose(counts[None] * 2 * np.pi / COUNTS_PER_TURN, arm.nominal())[0][0]
        assert np.linalg.norm(ours - perfect.tip(angles, COLD)) < 2.0  # counts are 0.8 mm
        exact = compute_pose((angles * directions)[None], arm.nominal())[0][0]
        assert np.linalg.norm(exact - perfect.tip(angles, COLD)) < 1e-3


def test_gravity_warmth_and_play_move_the_tip(perfect: PrintedArm) -> None:
    out = np.array([0.0, 0.9, -0.9, 0.0, 0.0])  # stretched out
    tip = perfect.tip(out, COLD)
    soft = replace(perfect, stiffness_nm=np.full(5, 150.0))
    loose = replace(perfect, play_rad=np.full(5, 0.001))
    assert soft.tip(out, COLD)[2] < tip[2] - 0.3
    assert loose.tip(out, COLD)[2] < tip[2] - 0.1
    warm = np.linalg.norm(perfect.tip(out, COLD + 10)) / np.linalg.norm(tip)
    assert warm == pytest.approx(1 + 700e-6, rel=1e-5)


def test_the_ball_is_in_its_seat() -> None:
    rng = np.random.default_rng(3)
    arm, seat = PrintedArm.draw(rng), np.array([240.0, 40.0, 60.0])
    for _ in range(3):
        assert np.linalg.norm(arm.tip(bench._posture(arm, rng, seat, COLD), COLD) - seat) < 1e-6


def test_how_large_a_cause_may_be_goes_with_the_encoders() -> None:
    """A count of 12 bits is 316″, of 23 bits a sixth of a second."""
    assert _coarseness(load_known_arm("so101")) == pytest.approx(316.4 / 6, rel=1e-3)
    fine = load_known_arm("so101").model_copy(deep=True)
    joints = [joint.model_copy(update={"counts_per_turn": 1 << 23}) for joint in fine.joint]
    assert _coarseness(fine.model_copy(update={"joint": joints})) == 1.0
    assert _coarseness(load_known_arm("openarm")) == 1.0  # not known

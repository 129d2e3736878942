"""Arms of 3 to 9 joints: drawing, true arm, heat and hand are of one arm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.kinematics import compute_pose
from armd.simulator.live.operator import Operator
from armd.simulator.live.physics import generate_blocks
from armd.simulator.servobus import arm as servo_arm
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import Materials, TrueArm
from armd.simulator.truth.effects.effect import Conditions, Masses
from armd.simulator.truth.true_values import list_true_expansion
from support.selection import parametrize_default

JOINTS = parametrize_default("n", range(3, 10), default=[0, 6])


def loaded(path: Path, text: str) -> Arm:
    path.write_text(text)
    return load_arm(path)


def worst_mm(arm: Arm, true: TrueArm, n: int) -> float:
    """Between the drawing's tip and the true one, over random postures at 20 °C."""
    q = np.random.default_rng(n).uniform(-2.0, 2.0, (50, n))
    drawn, _ = compute_pose(q, arm.nominal())
    return float(np.abs(drawn - true.tip(q, Conditions.at_rest(50, n))).max())


@JOINTS
def test_an_arm_made_to_its_drawing_is_its_drawing(n: int, tmp_path: Path) -> None:
    arm = loaded(tmp_path / "arm.toml", nominal.make_arm_toml(joints=n))
    assert arm.n_joints == n and arm.sensors == nominal.list_sensor_names(n)
    assert worst_mm(arm, TrueArm.default(deviation=0.0, joints=n), n) < 1e-4  # as printed


@JOINTS
def test_a_servo_arm_too(n: int, tmp_path: Path) -> None:
    arm = loaded(tmp_path / "arm.toml", servo_arm.make_arm_toml("S", n))
    which = servo_arm.list_parts(n)
    assert arm.n_joints == n == len(which) and set(which) <= set(range(5))
    rows = np.zeros((n, 5))
    rows[:, [0, 3]] = np.radians(servo_arm.DRAWING[which][:, [0, 3]])
    rows[:, [1, 2]] = servo_arm.DRAWING[which][:, [1, 2]]
    still = Materials.without_expansion(n)
    masses = Masses(np.zeros(n), np.zeros((n, 3)))
    true = TrueArm(rows, np.array(servo_arm.TIP_MM), still, masses)
    assert worst_mm(arm, true, n) < 1e-9
    printed = servo_arm.ServoArm(1, 20.0, joints=n)
    assert printed.truth.n_joints == n and len(printed.ids) == n + 1
    assert printed.warmth.celsius_at(np.array([0.0, 60.0])).shape == (2, n + 1)


@pytest.mark.parametrize("n", range(3, 10))
def test_its_true_expansion_is_by_the_sensors_of_its_links(n: int) -> None:
    """An arm without expansion whose lengths are those at these temperatures has the same tip."""
    arm = TrueArm.default(3, joints=n)
    celsius = dict(zip(nominal.list_sensor_names(n), 21.0 + 2.0 * np.arange(n), strict=True))
    rows, tip = arm.rows.copy(), arm.tip_offset.copy()
    for name, sensor, rate in list_true_expansion(arm):
        stem, which = name.split("_")
        grown_mm = rate * (celsius[sensor] - nominal.REFERENCE_C)
        if stem == "tip":
            tip["xyz".index(which)] += grown_mm
        else:
            rows[int(which) - 1, {"d": 1, "a": 2}[stem]] += grown_mm
    still = replace(arm, rows=rows, tip_offset=tip, materials=Materials.without_expansion(n))
    phi = np.random.default_rng(n).uniform(-2.0, 2.0, (20, n))
    rest = Conditions.at_rest(20, n)
    warm = Conditions.at_rest(20, n, np.array([*celsius.values()]))
    assert np.abs(arm.tip(phi, warm) - arm.tip(phi, rest)).max() > 0.01
    assert np.allclose(still.tip(phi, warm), arm.tip(phi, warm), rtol=0.0, atol=1e-9)


@JOINTS
def test_the_hand_rests_with_the_tip_in_seats_and_within_the_stops(n: int) -> None:
    arm = TrueArm.default(2, joints=n)
    hand = Operator(arm, 2)
    low, high = nominal.get_limits_rad(n)
    life = generate_blocks(arm, hand, 200, 20.0, None)
    pressed = 0
    for _ in range(40):
        block = next(life)
        assert block.encoder_rad.shape[1] == block.sensor_c.shape[1] == n
        assert ((block.encoder_rad > low) & (block.encoder_rad < high)).all()
        for tip_mm in block.tip_mm[block.buttons != 0]:
            away_mm = np.linalg.norm(hand.seats_mm - tip_mm, axis=1).min()
            assert away_mm < 0.005  # as far as the air of a room moves a resting arm
            pressed += 1
    assert pressed > 20

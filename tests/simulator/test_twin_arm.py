"""The twin on a wire: a daemon with its calibration publishes the tip where the twin's truly is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armd import Flag
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration, save_calibration
from armd.compensation.model.kinematics import compute_joint_jacobian
from armd.drivers.can import objects
from armd.files.toml_text import format_toml
from armd.simulator.canbus.parts import Encoder
from armd.simulator.live.electronics import ArmParts, Electronics
from armd.simulator.live.operator import Operator
from armd.simulator.twin.arm import BaseDrift, TwinArm, TwinHeat, find_comfort, generate_twin_blocks
from armd.simulator.twin.files import to_arm_data, to_calibration_data
from armd.simulator.twin.model import TwinModel
from armd.simulator.twin.noise import KNOT_S, FoundNoise
from support.drawn import drawn
from support.running_daemon import running_daemon
from support.simulated_arm import simulated_arm

COUNTS = 1 << 22
TERMS: list[dict[str, Any]] = [
    {"parameter": "theta_3", "basis": [{"kind": "cos", "joint": 3}], "coefficient": 2e-4},
    {"parameter": "theta_2", "basis": [{"kind": "side", "joint": 2}], "coefficient": 5e-5},
    {"parameter": "a_2", "coefficient": 0.02,
     "basis": [{"kind": "temperature", "weights": {"upper": 1.0}, "lag_s": 2.0}]},
    {"parameter": "theta_2", "coefficient": 1e-5,
     "basis": [{"kind": "gravity_torque", "joint": 2}]},
    {"parameter": "tip_x", "basis": [{"kind": "approach", "axis": "z"}], "coefficient": 0.05},
]  # fmt: skip


def an_arm() -> Arm:
    """Not the demo arm: other lengths, counts, directions, two sensors, one of them nobody's."""
    drawn = [(250.0, 0.0, 90.0), (0.0, 380.0, 0.0), (0.0, 30.0, 90.0), (300.0, 0.0, -90.0),
             (0.0, 0.0, 90.0), (80.0, 0.0, 0.0)]  # fmt: skip
    joints = [
        {
            "d_mm": d, "a_mm": a, "alpha_deg": alpha,
            "theta_deg": 90.0 if k == 2 else 0.0,
            "counts_per_turn": COUNTS >> (k % 2), "direction": -1 if k in (1, 4) else 1,
            "temperature": "upper" if k < 4 else None,
            "min_deg": [-170, -50, -150, -170, -100, -170][k],
            "max_deg": [170, 120, 5, 170, 100, 170][k],
        }
        for k, (d, a, alpha) in enumerate(drawn)
    ]  # fmt: skip
    return Arm.model_validate(
        {
            "schema": "armd.arm/1",
            "serial_number": "SHOP-7",
            "temperature_sensor": [{"name": "upper"}, {"name": "room"}],
            "joint": joints,
            "tip": {"offset_mm": [30.0, 0.0, 90.0]},
        }
    )


def calibrated(arm: Arm) -> Calibration:
    rng = np.random.default_rng(4)
    constants = arm.nominal() + rng.normal(0, 1e-3, arm.layout.count)
    more = {"created": "2026-09-01T00:00:00+00:00", "temperature_range_c": {"upper": [0.0, 60.0]}}
    return drawn(arm, values=constants, terms=TERMS, **more)


def half_counts_mm(arm: Arm) -> float:
    """The most that half a count at every joint moves the tip by, over the arm's postures."""
    q = np.random.default_rng(1).uniform(*arm.limits_rad, (400, 6))
    half = np.pi / np.array([joint.counts_per_turn for joint in arm.joint])
    moved = np.abs(compute_joint_jacobian(q, arm.nominal())) * half
    return float(np.linalg.norm(moved.sum(axis=2), axis=1).max())


def write_files(folder: Path) -> tuple[Arm, Calibration]:
    arm = an_arm()
    content = arm.model_dump(mode="json", by_alias=True, exclude_none=True)
    (folder / "arm.toml").write_text(format_toml(content))
    calibration = calibrated(arm)
    save_calibration(folder / "calibration.json", calibration)
    return arm, calibration


def twin_options(folder: Path) -> tuple[str, ...]:
    return ("--twin", str(folder / "calibration.json"), "--arm", str(folder / "arm.toml"))


def long_at_rest(points: np.ndarray) -> np.ndarray:
    """Points (n,) within rests that go on.

    When a joint turns back the daemon learns it after some counts; the flag stands until then. A
    lag that began at other temperatures has been forgotten after five of its times.
    """
    if len(points) < 100:
        return np.zeros(len(points), dtype=bool)
    rests: np.ndarray = (points["flags"] & Flag.AT_REST) != 0
    rests[:-50] &= rests[50:]
    rests[-50:] = False
    return rests & (points["seq"] > points["seq"][0] + 10 * 250)


@pytest.mark.slow
def test_a_daemon_with_its_calibration_publishes_where_the_twin_is(tmp_path: Path) -> None:
    arm, _ = write_files(tmp_path)
    truth = tmp_path / "truth.jsonl"
    options = (*twin_options(tmp_path), "--truth", str(truth), "--warm-up-k", "5")
    with (
        simulated_arm(tmp_path, *options, rate_hz=250, seconds=120, arm_toml=False) as twin,
        running_daemon(
            tmp_path, twin.port, top='calibration = "calibration.json"', serial="SHOP-7"
        ) as daemon,
        daemon.listen() as heard,
    ):
        heard.wait_for(lambda: long_at_rest(heard.points()).sum() > 500, 90.0)
        points = heard.points()
    lines = truth.read_text().splitlines(keepends=True)
    told = [json.loads(line) for line in lines if line.endswith("\n")]
    place = {line["seq"]: line["position_mm"] for line in told}
    true_mm = np.array([place[int(seq)] for seq in points["seq"]])
    apart = np.linalg.norm(points["position_mm"] - true_mm, axis=1)
    rests = long_at_rest(points)
    # What half a second and the sensors' steps of 0.01 °C leave of 0.02 mm/K: hardly anything.
    assert apart[rests].max() < half_counts_mm(arm) + 0.002
    plain = points["position_mm"] - points["correction_mm"]
    assert np.linalg.norm(plain - true_mm, axis=1)[rests].min() > 0.03


def test_counts_are_of_its_encoders_and_its_hand_keeps_to_its_stops() -> None:
    arm = an_arm()
    data = to_arm_data(arm.model_dump(mode="json", by_alias=True, exclude_none=True))
    twin = TwinArm(
        TwinModel(data, to_calibration_data(calibrated(arm).content(), 6)), FoundNoise(), 3
    )
    hand = Operator(twin, 3, find_comfort(data))
    life = generate_twin_blocks(twin, hand, 100, TwinHeat(twin, 21.0, None))
    electronics = Electronics(3, ArmParts(tuple(data.counts_per_turn), data.direction, 0.0, 0.0))  # type: ignore[arg-type]
    low, high = arm.limits_rad
    seats = set()
    for _ in range(30):
        block = next(life)
        assert ((block.encoder_rad > low) & (block.encoder_rad < high)).all()
        assert block.sensor_c.shape == (10, 2) and np.isfinite(block.tip_mm).all()
        counts = electronics.counts(block.encoder_rad).astype(np.int64)
        turn = np.array(data.counts_per_turn, dtype=np.int64)
        back = counts * data.direction * 2 * np.pi / turn
        off = np.angle(np.exp(1j * (back - block.encoder_rad)))
        assert (np.abs(off) <= np.pi / turn + 1e-12).all()
        for row in np.flatnonzero(block.buttons):
            apart = np.linalg.norm(hand.seats_mm - block.tip_mm[row], axis=1)
            seats.add(int(np.argmin(apart)))
            assert apart.min() < 0.2  # the side of approach, which the hand does not foresee
    assert len(seats) >= 3
    assert electronics.parts.bits == (22, 21) * 3


def test_an_encoder_on_can_says_what_its_counts_are() -> None:
    places = (objects.UNITS_PER_TURN, objects.TOTAL_RANGE, objects.PHYSICAL_RESOLUTION)
    own = Encoder(3, 16000)
    assert [own._objects.number(place, 0) for place in places] == [16000] * 3
    assert Encoder(3)._objects.number(objects.UNITS_PER_TURN, 0) == 1 << 23


def test_a_base_drifts_by_what_was_found_from_knot_to_knot() -> None:
    steps = []
    for seed in range(40):
        drift = BaseDrift(0.004, seed)
        path = drift.shift_mm_at(np.arange(0.0, 8 * KNOT_S, KNOT_S))
        middle = drift.shift_mm_at(np.array([KNOT_S / 2]))[0]
        assert np.abs(middle - path[:2].mean(axis=0)).max() < 1e-12
        steps.append(np.diff(path, axis=0))
    assert np.std(steps) == pytest.approx(0.004, rel=0.1)
    assert not BaseDrift(0.0, 1).shift_mm_at(np.arange(3.0)).any()


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (("counts_per_turn = 4194304", "counts_per_turn = 4000000"), "a power of two"),
        (("counts_per_turn = 4194304\n", ""), "joint[1].counts_per_turn: found nothing"),
    ],
)
def test_what_a_serial_wire_cannot_carry_is_refused(
    change: tuple[str, str], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from armd.simulator.__main__ import main

    write_files(tmp_path)
    path = tmp_path / "arm.toml"
    path.write_text(path.read_text().replace(*change))
    assert main([*twin_options(tmp_path), "--serial", "--seconds", "1"]) == 2
    told = capsys.readouterr()
    assert expected in told.err and not told.out

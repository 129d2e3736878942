"""Encoders of 4096 counts and thermometers of whole degrees: what of their steps is a motion, a
turning back, a drift."""

import math

import numpy as np
import pytest

from armd import Flag
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.config import Limits
from armd.daemon.live.pipeline import Pipeline
from armd.daemon.live.temperature_rate import CoarseHistory
from armd.daemon.live.temperature_watch import TemperatureWatch
from armd.drivers.sample import sample_dtype
from support.small_arm import COUNTS  # the small arm's own encoders are fine

RATE_HZ = 500


def servo_arm():
    """Two links of 200 mm and one of 50: 0.3 mm of tip to a count of the elbow."""
    joint = {"theta_deg": 0.0, "d_mm": 0.0, "beta_deg": 0.0, "counts_per_turn": 4096}
    lengths = [(0.0, 90.0), (200.0, 0.0), (200.0, 0.0), (50.0, 0.0)]
    return Arm.model_validate(
        {
            "schema": "armd.arm/1",
            "serial_number": "SERVO",
            "reference_temperature_c": 20.0,
            "temperature_sensor": [{"name": "t1"}],
            "joint": [
                joint | {"a_mm": a, "alpha_deg": alpha, "temperature": "t1"} for a, alpha in lengths
            ],
            "tip": {"offset_mm": [0.0, 0.0, 0.0], "radius_mm": 1.0},
        }
    )


def points(counts):
    """Of counts (n, 4), RATE_HZ a second."""
    samples = np.zeros(len(counts), sample_dtype(4))
    samples["count"] = counts
    samples["seq"] = np.arange(len(counts))
    samples["monotonic_ns"] = 10**12 + np.arange(len(counts)) * (10**9 // RATE_HZ)
    samples["clock_mapped"] = True
    return Pipeline(servo_arm(), None, Limits()).correct(samples)


def resting(found):
    return (found["flags"] & int(Flag.AT_REST)) != 0


def test_flicker_of_a_count_to_either_side_is_rest():
    rng = np.random.default_rng(1)
    counts = np.array([100, 300, -500, 40]) + rng.integers(-1, 2, (1000, 4)) * (
        rng.random((1000, 4)) < 0.1
    )
    found, joints = points(counts)
    assert resting(found)[RATE_HZ * 3 // 5 :].all()
    assert np.isnan(joints.rate[:1000]).all()  # and nothing has turned to either side


@pytest.mark.parametrize("joint", [0, 1, 2])
@pytest.mark.parametrize("phase", [-0.49, 0.0, 0.4])
def test_rest_ends_soon_after_the_start_of_a_motion(joint, phase):
    time_s = np.arange(2 * RATE_HZ) / RATE_HZ
    lever_mm = [450.0, 450.0, 250.0][joint]  # the arm is stretched out
    # Two counts at the least: at 0.45 m these are 1.4 mm, and 0.12 s of them 12 mm/s.
    counts_per_s = 12.0 / lever_mm / (2 * math.pi / 4096)
    counts = np.zeros((len(time_s), 4))
    counts[:, joint] = np.round(phase + np.clip(time_s - 1.0, 0.0, None) * counts_per_s)
    found, _ = points(counts)
    assert resting(found)[time_s < 1.0].any()
    assert not resting(found)[time_s > 1.12].any()


@pytest.mark.parametrize("noise_counts", [0.2, 0.3, 0.5])
def test_an_encoder_s_noise_never_ends_a_rest(noise_counts):
    """Wherever within their counts the joints stand: flicker of two counts in a row of rows is
    rare, in some row of a long rest it is sure to come."""
    rng = np.random.default_rng(round(10 * noise_counts))
    for _ in range(8):
        phase = rng.uniform(-0.5, 0.5, 4)
        noise = rng.normal(0.0, noise_counts, (20 * RATE_HZ, 4))
        found, _ = points(np.rint(np.array([100, 300, -500, 40]) + phase + noise))
        assert resting(found)[RATE_HZ:].all()


def test_rest_ends_soon_after_joints_begin_to_move_together():
    """None of them need be two counts away, and until one of them moves by a whole count nobody
    can see anything; when one of them is in its second count, it is a motion in three rows."""
    rng = np.random.default_rng(0)
    arm, count_rad = servo_arm().nominal(), 2 * math.pi / 4096
    time_s = np.arange(2 * RATE_HZ) / RATE_HZ
    soon = []
    for _ in range(60):
        begin, way = rng.uniform(-0.6, 0.6, 4), rng.normal(size=4)
        tips, _ = compute_pose(np.array([begin, begin + 1e-6 * way]), arm)
        way *= 12.0 / (np.linalg.norm(tips[1] - tips[0]) / 1e-6)
        angles = begin + np.clip(time_s - 1.0, 0.0, None)[:, None] * way
        counts = np.round(angles / count_rad)
        found, _ = points(counts)
        assert resting(found)[time_s < 1.0].any()
        outlasts_s = time_s[resting(found)].max() - 1.0
        in_second_s = time_s[(np.abs(counts - counts[0]) >= 2).any(axis=1)].min() - 1.0
        assert outlasts_s <= in_second_s + 3 / RATE_HZ
        soon.append(outlasts_s < in_second_s - 3 / RATE_HZ)
    assert np.mean(soon) > 0.2  # several joints tell it together, before any of them does


def watch(readings):
    """Of (second, °C) of one sensor."""
    found = TemperatureWatch(servo_arm(), Limits())
    for second, celsius in readings:
        found.update(np.array([celsius]), round(second * 1e9), 1.0)
    return found


def test_a_step_of_a_degree_is_no_fast_change():
    told = [(k / 2, 30.0 if k < 100 else 31.0) for k in range(400)]
    for n in range(20, 400, 7):
        assert Flag.TEMPERATURE_RATE not in watch(told[:n]).temperature_flags
    flickering = [(k / 2, 30.0 + (k % 3 == 0)) for k in range(100)]
    assert Flag.TEMPERATURE_RATE not in watch(flickering).temperature_flags


@pytest.mark.parametrize("k_per_s", [90.0 / 3600, 1.0])
def test_what_no_step_explains_is_a_fast_change(k_per_s):
    told = [(k / 2, float(round(30 + k_per_s * k / 2))) for k in range(360)]
    assert Flag.TEMPERATURE_RATE in watch(told).temperature_flags


def test_the_certain_rate_against_the_plain_formula():
    rng = np.random.default_rng(3)
    celsius = np.round(25 + np.cumsum(rng.normal(0, 0.2, 200)))
    history = CoarseHistory(["t1"], 1.0)
    for k, value in enumerate(celsius):
        history.append([value], k * 500_000_000)
    drift = history.fastest(np.array([0]))
    hours = np.arange(200) * 0.5 / 3600
    certain = max(
        (abs(celsius[-1] - celsius[i]) - 1.0) / (hours[-1] - hours[i]) for i in range(199)
    )
    assert drift.jump_k_per_h == pytest.approx(max(certain, 0.0))
    assert COUNTS > 1 << 15  # else the small arm's tests would see coarse encoders

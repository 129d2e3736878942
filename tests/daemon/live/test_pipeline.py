"""Samples in, points out: flags with their reasons, and the same points however they are cut."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armd import Flag
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.slow_factors import Temperature, Time
from armd.compensation.model.terms import Term
from armd.compiled import library
from armd.daemon.config import Limits
from armd.daemon.live.pipeline import Pipeline
from armd.drivers.sample import Temperatures
from support.small_arm import reading, samples_of, small_arm, thermal_calibration

POSE = np.array([10.0, -20.0, 30.0])
WARM = [20.0, 20.0, 20.0]


def still(n: int, first_seq: int = 0) -> np.ndarray:
    return samples_of(np.tile(POSE, (n, 1)), first_seq=first_seq)


def calibrated(**changes) -> Pipeline:
    arm = small_arm()
    return Pipeline(arm, thermal_calibration(arm, **changes), Limits())


def flagged(points: np.ndarray, flag: Flag) -> np.ndarray:
    return (points["flags"] & flag) != 0


def test_points_are_forward_kinematics_of_the_warm_arm():
    pipeline = calibrated()
    pipeline.take_temperatures(reading([20.0, 25.0, 20.0], 0))
    points, _ = pipeline.correct(still(3))
    samples = still(1)
    q = samples["count"] * np.array([1, -1, 1]) * 2 * math.pi / (1 << 20)
    cold = small_arm().nominal()
    warm = cold.copy()
    warm[7] += 0.05  # a_2, 5 K warmer
    np.testing.assert_allclose(points["position_mm"][:1], compute_pose(q, warm)[0], atol=1e-9)
    moved = compute_pose(q, warm)[0] - compute_pose(q, cold)[0]
    np.testing.assert_allclose(points["correction_mm"][:1], moved, atol=1e-7)
    for name in ("seq", "stamp_ns", "monotonic_ns"):
        np.testing.assert_array_equal(points[name], still(3)[name])
    assert (
        points["calibration"] == int.from_bytes(bytes.fromhex("0123456789abcdef"), "little")
    ).all()


def test_samples_of_another_kind_never_reach_what_was_settled_for_others(monkeypatch):
    """Machine code would read them as lying one behind the other."""
    settled_for = []

    def settled(function, samples, *_):
        kind = library.describe_kind(samples)
        settled_for.append(kind)
        return lambda samples, *_: calls.append(library.describe_kind(samples) == kind)

    calls: list[bool] = []
    pipeline = calibrated()
    monkeypatch.setattr("armd.daemon.live.pipeline.select_compiled", settled)
    for samples in (still(1), still(9), still(9)[::2], still(2), still(2)):
        pipeline.correct(samples)
    assert calls == [True] * 5
    assert len(settled_for) == 3 and settled_for[0] == settled_for[2] != settled_for[1]


def test_points_of_one_call_are_nobody_elses_later():
    pipeline = calibrated()
    pipeline.take_temperatures(reading(WARM, 0))
    kept = [(pipeline.correct(still(n, seq))[0], n, seq) for n, seq in ((1, 0), (300, 1), (7, 400))]
    kept += [(pipeline.correct(still(1, seq))[0], 1, seq) for seq in range(500, 1100)]
    for points, n, seq in kept:
        np.testing.assert_array_equal(points["seq"], np.arange(seq, seq + n))


def test_without_calibration_points_are_nominal_and_say_so():
    pipeline = Pipeline(small_arm(), None, Limits())
    pipeline.take_temperatures(reading(WARM, 0))
    points, _ = pipeline.correct(still(2))
    assert flagged(points, Flag.NOT_CALIBRATED).all()
    assert (points["calibration"] == 0).all() and (points["correction_mm"] == 0).all()
    assert not flagged(calibrated().correct(still(2))[0], Flag.NOT_CALIBRATED).any()


def test_flag_0_a_joint_is_invalid_and_all_numbers_are_nan():
    samples = still(5)
    samples["joint_invalid"][2] = 0b100
    points, _ = calibrated().correct(samples)
    np.testing.assert_array_equal(flagged(points, Flag.INVALID), [0, 0, 1, 0, 0])
    for name in ("position_mm", "orientation", "covariance_mm2", "correction_mm"):
        assert np.isnan(points[name][2]).all()
    assert np.isfinite(points["position_mm"][[0, 1, 3, 4]]).all()


@pytest.mark.parametrize(("b_c", "outside"), [(29.9, False), (30.1, True), (14.0, True)])
def test_flag_1_outside_the_identified_range(b_c, outside):
    pipeline = calibrated()
    pipeline.take_temperatures(reading([20.0, b_c, 90.0], 0))  # nobody uses sensor c
    assert flagged(pipeline.correct(still(1))[0], Flag.TEMPERATURE_RANGE) == outside


def test_flag_2_until_the_first_reading_and_after_5_s_and_flag_0_after_30_s_of_silence():
    pipeline = calibrated()
    assert flagged(pipeline.correct(still(1))[0], Flag.TEMPERATURE_STALE)
    pipeline.take_temperatures(reading([20.0, 25.0, 20.0], 0))
    points, _ = pipeline.correct(still(31_000))
    stale, invalid = flagged(points, Flag.TEMPERATURE_STALE), flagged(points, Flag.INVALID)
    assert np.argmax(stale) == 5001 and stale[5001:].all()
    assert np.argmax(invalid) == 30_001 and invalid[30_001:].all()
    np.testing.assert_array_equal(points["position_mm"][0], points["position_mm"][30_000])
    pipeline.take_temperatures(reading(WARM, 31.0))
    points, _ = pipeline.correct(still(1, 31_000))
    assert not flagged(points, Flag.TEMPERATURE_STALE | Flag.INVALID)


def test_flag_2_when_a_used_channel_is_invalid_and_its_last_value_is_held():
    pipeline = calibrated()
    pipeline.take_temperatures(reading([20.0, 25.0, 20.0], 0))
    before, _ = pipeline.correct(still(1))
    pipeline.take_temperatures(reading([20.0, math.nan, 20.0], 0.5))
    after, _ = pipeline.correct(still(1, 500))
    assert flagged(after, Flag.TEMPERATURE_STALE) and not flagged(after, Flag.INVALID)
    np.testing.assert_array_equal(after["position_mm"], before["position_mm"])
    pipeline.take_temperatures(reading([20.0, 25.0, math.nan], 1.0))  # nobody uses sensor c
    assert not flagged(pipeline.correct(still(1, 1000))[0], Flag.TEMPERATURE_STALE)


@pytest.mark.parametrize(("k_per_h", "fast"), [(50.0, False), (70.0, True)])
def test_flag_3_above_the_limit(k_per_h, fast):
    pipeline = calibrated(max_temperature_rate_k_per_h=60.0)
    for k in range(60):
        pipeline.take_temperatures(reading([20.0, 20.0 + k_per_h * k / 7200, 20.0], k / 2))
    points, _ = pipeline.correct(still(1, 29_500))
    assert flagged(points, Flag.TEMPERATURE_RATE) == fast


def test_flag_3_at_once_when_a_temperature_jumps():
    pipeline = calibrated()
    for k in range(20):
        pipeline.take_temperatures(reading([20.0, 20.0 + 5.0 * (k == 19), 20.0], k / 2))
        points, _ = pipeline.correct(still(1, 500 * k))
        assert flagged(points, Flag.TEMPERATURE_RATE) == (k == 19)


def test_flags_4_and_8_a_joint_warns_and_until_the_clock_is_mapped():
    samples = still(2)
    samples["joint_warning"][1] = 1
    samples["clock_mapped"] = [False, True]
    points, _ = calibrated().correct(samples)
    np.testing.assert_array_equal(flagged(points, Flag.JOINT_WARNING), [0, 1])
    np.testing.assert_array_equal(flagged(points, Flag.CLOCK), [1, 0])
    assert np.isfinite(points["position_mm"]).all()


def test_flag_5_within_half_a_degree_of_a_limit_whatever_turn_the_encoder_woke_up_in():
    angles = np.array([[0, 0, 0], [169.4, 0, 0], [169.6, 0, 0], [0, -169.6, 0], [0, 0, 171.0]])
    points, _ = calibrated().correct(samples_of(angles))
    np.testing.assert_array_equal(flagged(points, Flag.END_STOP), [0, 0, 1, 1, 1])
    arm = small_arm()

    joint = arm.joint[0].model_copy(update={"min_deg": 90.0, "max_deg": 300.0})
    arm = arm.model_copy(update={"joint": [joint, *arm.joint[1:]]})
    points, _ = Pipeline(arm, None, Limits()).correct(
        samples_of(np.array([[-170.0, 0, 0], [190.0, 0, 0], [-60.2, 0, 0], [90.2, 0, 0]]))
    )
    np.testing.assert_array_equal(flagged(points, Flag.END_STOP), [0, 0, 1, 1])


def test_flag_6_exactly_where_seq_does_not_follow():
    samples = still(8)
    pipeline = calibrated()
    first, _ = pipeline.correct(samples[[0, 1, 3]])
    second, _ = pipeline.correct(samples[[4, 7]])
    lost = np.concatenate([flagged(first, Flag.SAMPLES_LOST), flagged(second, Flag.SAMPLES_LOST)])
    np.testing.assert_array_equal(lost, [0, 0, 1, 0, 1])
    assert not flagged(calibrated().correct(still(1, 77))[0], Flag.SAMPLES_LOST)


def test_flag_9_after_half_a_second_of_rest():
    points, joints = calibrated().correct(still(600))
    resting = flagged(points, Flag.AT_REST)
    assert np.argmax(resting) == 500 and resting[500:].all()
    assert (joints.still_since_ns[:600] == points["monotonic_ns"][0]).all()


def test_another_calibration_holds_from_the_next_sample_on():
    arm = small_arm()
    pipeline = Pipeline(arm, None, Limits())
    pipeline.take_temperatures(reading([20.0, 25.0, 20.0], 0))
    pipeline.correct(still(600))
    pipeline.use(pipeline.prepare(arm, thermal_calibration(arm)))
    points, _ = pipeline.correct(still(1, 600))
    assert points["flags"] == Flag.AT_REST  # known temperatures, the rest goes on
    assert np.linalg.norm(points["correction_mm"]) > 0.03


def test_a_reload_knows_the_temperatures_of_the_past():
    arm = small_arm()
    lagging = [
        Term(
            parameter="a_2",
            basis=[Temperature(weights={"b": 1.0}, lag_s=600.0)],
            coefficient=0.01,
        )
    ]
    calibration = thermal_calibration(arm, terms=lagging)

    def warm_up(pipeline: Pipeline) -> None:
        for k in range(120):  # ten minutes, 10 K
            pipeline.take_temperatures(reading([20.0, 20.0 + k / 12, 20.0], 5.0 * k))

    first = Pipeline(arm, calibration, Limits())
    warm_up(first)
    reloaded = Pipeline(arm, None, Limits())
    warm_up(reloaded)
    reloaded.use(reloaded.prepare(arm, calibration))
    late = still(1, 595_000)
    expected = first.correct(late)[0]["correction_mm"]
    np.testing.assert_allclose(reloaded.correct(late)[0]["correction_mm"], expected, atol=2e-4)
    settled = Pipeline(arm, calibration, Limits())
    settled.take_temperatures(reading([20.0, 30.0, 20.0], 595.0))
    assert np.abs(settled.correct(late)[0]["correction_mm"] - expected).max() > 0.02


def drifting(**period) -> list[Term]:
    return [Term(parameter="a_1", basis=[Time(**period)], coefficient=0.005)]


UNIX_S = 1_700_000_000.0 + 1.0  # of `samples_of` at 0 s


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(1, 90), min_size=2, max_size=12), st.integers(0, 2**32 - 1))
def test_a_replay_gives_the_same_bits_however_the_stream_is_cut(cuts, seed):
    rng = np.random.default_rng(seed)
    n = sum(cuts)
    angles = POSE + np.cumsum(rng.normal(0, 0.02, (n, 3)), axis=0)
    samples = samples_of(angles, rate_hz=200)
    samples["joint_invalid"][rng.random(n) < 0.02] = 1

    warm = reading([21.0, 24.0, 20.0], 0)
    arm = small_arm()
    thermal = thermal_calibration(arm).content.terms
    terms = [*thermal, *drifting(since_unix_s=UNIX_S, until_unix_s=UNIX_S + 9e3)]

    def replay(pieces: list[np.ndarray | Temperatures]) -> bytes:
        pipeline = Pipeline(arm, thermal_calibration(arm, terms=terms), Limits())
        out = []
        for piece in pieces:
            if isinstance(piece, Temperatures):
                pipeline.take_temperatures(piece)
            else:
                out.append(pipeline.correct(piece)[0].tobytes())
        return b"".join(out)

    half = n // 2
    whole = replay([samples[:half], warm, samples[half:]])
    head = np.split(samples[:half], np.cumsum(cuts)[np.cumsum(cuts) < half])
    tail = np.split(samples[half:], [k - half for k in np.cumsum(cuts) if half < k < n])
    assert replay([*(p for p in head if len(p)), warm, *(p for p in tail if len(p))]) == whole


def test_an_arm_without_sensors_needs_no_temperature():
    arm = small_arm()
    joints = [joint.model_copy(update={"temperature": None}) for joint in arm.joint]
    bare = arm.model_copy(update={"joint": joints, "temperature_sensor": []})
    pipeline = Pipeline(bare, None, Limits())
    points, _ = pipeline.correct(still(2))
    pipeline.take_temperatures(Temperatures(np.zeros(0), 0, 10**9, 10**18))
    points, _ = pipeline.correct(still(40_000, 2))
    assert not flagged(points, Flag.TEMPERATURE_STALE | Flag.INVALID).any()
    assert pipeline.temperature.unsteady(1.0) == ""


def test_a_sensor_is_told_lost_once_it_had_a_value_or_has_been_waited_for():
    watch = calibrated().temperature
    watch.begin(10**9)
    assert watch.stale_sensors(10**9) == ("a", "b")  # nobody spoke yet
    assert watch.sensors_to_report(10**9) == ()
    first = reading([20.0, math.nan, 20.0], 0.1)
    watch.update(first.celsius, first.monotonic_ns)
    assert watch.stale_sensors(2 * 10**9) == ("b",) and watch.sensors_to_report(2 * 10**9) == ()
    assert watch.sensors_to_report(6_200_000_000) == ("a", "b")  # a is stale by now, b never came
    warm = reading(WARM, 6.0)
    watch.update(warm.celsius, warm.monotonic_ns)
    assert watch.sensors_to_report(7 * 10**9) == ()
    gone = reading([20.0, math.nan, math.nan], 6.5)
    watch.update(gone.celsius, gone.monotonic_ns)
    assert watch.sensors_to_report(7_500_000_000) == ("b",)


def test_what_is_not_finite_is_invalid():
    huge = Term(parameter="a_2", basis=[Temperature(weights={"b": 1.0})], coefficient=1e307)
    pipeline = calibrated(terms=[huge])
    pipeline.take_temperatures(reading([20.0, 60.0, 20.0], 0))
    points, _ = pipeline.correct(still(2))
    assert flagged(points, Flag.INVALID).all() and np.isnan(points["position_mm"]).all()
    pipeline.take_temperatures(reading([20.0, 20.0, 20.0], 0.5))
    assert not flagged(pipeline.correct(still(1, 600))[0], Flag.INVALID)


def correction_x(pipeline: Pipeline, at_s: float) -> tuple[float, bool]:
    """Joint 1 carries link 1 along x."""
    samples = samples_of(np.zeros((1, 3)), first_seq=round(at_s * 1000))
    (point,), _ = pipeline.correct(samples)
    return float(point["correction_mm"][0]), bool(point["flags"] & Flag.TEMPERATURE_RANGE)


@pytest.mark.parametrize("sensors", [True, False])
def test_a_term_that_follows_time_is_evaluated_at_the_samples_and_held_beyond_its_period(sensors):
    period = {"since_unix_s": UNIX_S - 3600, "until_unix_s": UNIX_S + 3600}
    arm = small_arm()
    if not sensors:
        joints = [joint.model_copy(update={"temperature": None}) for joint in arm.joint]
        arm = arm.model_copy(update={"joint": joints, "temperature_sensor": []})
    pipeline = Pipeline(arm, thermal_calibration(arm, terms=drifting(**period)), Limits())
    assert correction_x(pipeline, 0.0) == (pytest.approx(0.005, rel=1e-5), False)
    for at_s, mm, outside in (
        (1800.0, 0.0075, False),
        (3599.0, 0.01, False),
        (90_000.0, 0.01, True),
    ):
        if sensors:
            pipeline.take_temperatures(reading(WARM, at_s - 0.3))
        assert correction_x(pipeline, at_s) == (pytest.approx(mm, rel=1e-3), outside)
    assert pipeline.outside_period == (period["since_unix_s"], period["until_unix_s"])


def test_a_lag_starts_with_the_first_measured_temperature():
    arm = small_arm()
    lagging = [
        Term(
            parameter="a_1", basis=[Temperature(weights={"b": 1.0}, lag_s=600.0)], coefficient=0.01
        ),
        *drifting(since_unix_s=UNIX_S - 3600),  # so that samples alone fold the model too
    ]
    pipeline = Pipeline(arm, thermal_calibration(arm, terms=lagging), Limits())
    pipeline.correct(still(3))
    pipeline.take_temperatures(reading([20.0, math.nan, 20.0], 0.5))
    pipeline.take_temperatures(reading([20.0, 30.0, 20.0], 1.0))
    assert correction_x(pipeline, 1.1)[0] == pytest.approx(0.1 + 0.005, rel=1e-3)


def test_temperatures_at_a_kilohertz_are_thinned_out_and_a_lost_channel_is_not():
    pipeline = calibrated()
    watch = pipeline.temperature
    for k in range(70_000):
        pipeline.take_temperatures(reading([20.0, 20.0 + k * 1e-4, 20.0], k * 1e-3))
    assert 1190 <= len(watch._history) <= 1210  # a minute at 20 Hz
    assert watch.held_c[1] == pytest.approx(27.0, abs=0.01)
    assert watch.drift.k_per_h == pytest.approx(360.0, rel=1e-3)
    pipeline.take_temperatures(reading([20.0, math.nan, 20.0], 70.0001))
    assert flagged(pipeline.correct(still(1, 70_001))[0], Flag.TEMPERATURE_STALE)


def test_readings_whose_time_stands_still_or_runs_back_do_not_pile_up():
    watch = calibrated().temperature
    for k in range(5000):
        again = reading(WARM, 3600.0 - k % 7)
        watch.update(again.celsius, again.monotonic_ns)
    assert len(watch._history) <= 16


def test_modules_that_answer_one_after_the_other_are_all_heard():
    watch = calibrated().temperature
    for k in range(20):
        for late_s, celsius in ((0.0, [20.0, math.nan, 20.0]), (0.01, [20.0, 21.0 + k, 20.0])):
            module = reading(celsius, k / 2 + late_s)
            assert watch.update(module.celsius, module.monotonic_ns)
        assert watch.held_c[1] == 21.0 + k

"""Rest, rates and sides of approach, decided sample by sample."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armd.daemon.live import motion
from armd.daemon.live.motion import REST_AFTER_NS, SIDE_PLAY_RAD, Motion
from armd.drivers.sample import sample_dtype

COUNTS = [1 << 23] * 3


def samples_at(time_ns: np.ndarray, invalid: np.ndarray | int = 0) -> np.ndarray:
    samples = np.zeros(len(time_ns), sample_dtype(3))
    samples["monotonic_ns"] = time_ns
    samples["joint_invalid"] = invalid
    return samples


REACH_MM = 1000.0


def go_on(
    followed: Motion, samples: np.ndarray, q: np.ndarray, position_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rate (n, N), approach (n, 3) and still_since_ns (n,) of the next samples."""
    n = len(q)
    said = np.empty(q.shape), np.empty((n, 3)), np.empty(n, np.int64)
    motion.follow(samples, q, position_mm, followed.memory, *said)
    return said


def follow(position_mm: np.ndarray, rate_hz: int = 1000, q: np.ndarray | None = None):
    """Everything that is said of a motion of the tip at a steady rate."""
    n = len(position_mm)
    q = np.zeros((n, 3)) if q is None else q
    time_ns = np.arange(n) * (10**9 // rate_hz)
    followed = Motion(COUNTS, REACH_MM)
    rate, approach, still_ns = go_on(followed, samples_at(time_ns), q, position_mm)
    return rate, approach, time_ns - still_ns >= REST_AFTER_NS


def along_x(x_mm: np.ndarray) -> np.ndarray:
    return np.stack([x_mm, 0 * x_mm, 0 * x_mm], axis=1)


def noise(n: int, sigma_mm: float, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, sigma_mm, (n, 3))


def smooth(n: int, length_mm: float) -> np.ndarray:
    """A minimum-jerk stroke over n samples."""
    s = np.linspace(0, 1, n)
    return length_mm * (10 * s**3 - 15 * s**4 + 6 * s**5)


@pytest.mark.parametrize("rate_hz", [100, 1000, 5000])
@pytest.mark.parametrize("sigma_mm", [0.0, 0.002, 0.01])
def test_never_at_rest_while_the_tip_moves_fast_and_soon_after_it_stopped(rate_hz, sigma_mm):
    stroke = smooth(rate_hz, 200.0)
    x = np.concatenate([np.zeros(rate_hz), stroke, np.full(2 * rate_hz, 200.0)])
    resting = follow(along_x(x) + noise(len(x), sigma_mm), rate_hz)[2]
    speed = np.abs(np.gradient(x)) * rate_hz
    assert not resting[speed > 10].any()
    assert resting[-rate_hz:].all()
    # The first and last tenth of a smooth stroke may be less than noise and tremor.
    stopped = 2 * rate_hz
    assert not resting[rate_hz + rate_hz // 10 : stopped + int(0.4 * rate_hz)].any()


def test_a_sudden_start_is_seen_at_once():
    x = np.concatenate([np.zeros(1000), 12e-3 * np.arange(1, 200)])  # 12 mm/s from one to the next
    resting = follow(along_x(x))[2]
    assert resting[999]
    assert not resting[1000:].any()


def test_slow_creep_is_not_rest_when_it_goes_on():
    x = 5e-3 * np.arange(3000)  # 5 mm/s
    assert not follow(along_x(x))[2].any()


def test_after_a_gap_nobody_knows_whether_it_rested():
    followed = Motion(COUNTS, REACH_MM)
    q, tip = np.zeros((1000, 3)), np.zeros((1000, 3))
    time_ns = np.arange(1000) * 1_000_000
    go_on(followed, samples_at(time_ns), q, tip)
    later_ns = time_ns + 2_000_000_000
    still_ns = go_on(followed, samples_at(later_ns), q, tip)[2]
    assert (still_ns == later_ns[0]).all()


def test_an_invalid_sample_ends_a_rest():
    invalid = np.zeros(1000, np.uint16)
    invalid[700] = 1
    time_ns = np.arange(1000) * 1_000_000
    nowhere = np.zeros((1000, 3))
    samples = samples_at(time_ns, invalid)
    still_ns = go_on(Motion(COUNTS, REACH_MM), samples, nowhere, nowhere)[2]
    assert still_ns[699] == 0 and still_ns[701] == time_ns[701]


def test_rate_and_side_of_approach():
    q = np.zeros((300, 3))
    q[:100, 0] = np.linspace(0, 0.1, 100)
    q[100:, 0] = 0.1
    q[200:, 0] -= 0.5 * SIDE_PLAY_RAD  # noise, not a turn
    q[:, 1] = -np.linspace(0, 0.3, 300)
    rate = follow(np.zeros((300, 3)), q=q)[0]
    np.testing.assert_allclose(rate[2:100, 0], 0.1 / 99 * 1000, rtol=1e-9)
    assert (np.sign(rate[10:, 0]) == 1).all()  # held at rest
    assert np.abs(rate[101:, 0]).max() < 1e-9
    assert (np.sign(rate[10:, 1]) == -1).all()
    assert np.isnan(rate[:, 2]).all()  # never moved: unknown


def test_approach_is_the_direction_of_travel_and_is_held():
    x = np.concatenate([np.linspace(0, 50, 500), np.full(500, 50.0)])
    approach = follow(along_x(x) + noise(1000, 0.002))[1]
    assert np.isnan(approach[0]).all()
    np.testing.assert_allclose(approach[100:], [[1, 0, 0]] * 900, atol=0.05)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(1, 40), min_size=1, max_size=20), st.integers(0, 2**32 - 1))
def test_batches_do_not_matter(cuts, seed):
    rng = np.random.default_rng(seed)
    n = sum(cuts)
    q = np.cumsum(rng.normal(0, 1e-3, (n, 3)), axis=0)
    tip = np.cumsum(rng.normal(0, 0.02, (n, 3)), axis=0)
    time_ns = np.cumsum(rng.integers(5 * 10**5, 2 * 10**8, n))
    invalid = (rng.random(n) < 0.05).astype(np.uint16)
    samples = samples_at(time_ns, invalid)
    whole = go_on(Motion(COUNTS, REACH_MM), samples, q, tip)
    followed, parts = Motion(COUNTS, REACH_MM), []
    for rows in np.split(np.arange(n), np.cumsum(cuts)[:-1]):
        parts.append(go_on(followed, samples[rows], q[rows], tip[rows]))
    for one, cut in zip(whole, zip(*parts, strict=True), strict=True):
        np.testing.assert_array_equal(one, np.concatenate(cut))


@pytest.mark.parametrize("rate_hz", [9, 5, 2])
def test_below_ten_samples_a_second_it_rests_too(rate_hz):
    n = 3 * rate_hz
    time_ns = np.arange(2 * n) * (10**9 // rate_hz)
    samples = samples_at(time_ns)
    samples["seq"] = 7 + np.arange(2 * n)
    x_mm = np.concatenate([np.zeros(n), 20.0 / rate_hz * np.arange(n)])  # still, then 20 mm/s
    followed = Motion(COUNTS, REACH_MM)
    _, _, still_ns = go_on(followed, samples, np.zeros((2 * n, 3)), along_x(x_mm))
    rests = time_ns - still_ns >= REST_AFTER_NS
    assert rests[rate_hz : n + 1].all()
    assert not rests[n + 1 :].any()
    samples["seq"][n - 2 :] += 1  # one is missing: nobody knows what the tip did then
    _, _, still_ns = go_on(Motion(COUNTS, REACH_MM), samples, np.zeros((2 * n, 3)), along_x(x_mm))
    assert still_ns[n - 2] == time_ns[n - 2]

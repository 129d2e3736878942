"""The fastest change of a temperature against the plain formula over the whole history."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armd.daemon.live.temperature_rate import (
    RATE_AFTER_NS,
    RATE_OVER_NS,
    ROOM,
    STEP_K,
    Drift,
    RecentReadings,
)

SENSORS = ["t1", "t2", "t3"]
SECOND_NS = 1_000_000_000


def plain(times_ns: np.ndarray, celsius: np.ndarray, used: list[int]) -> Drift | None:
    """Of the readings (n,) and (n, S) that are kept."""
    if len(times_ns) < 3 or times_ns[-1] - times_ns[0] < RATE_AFTER_NS:
        return None
    steady = [i for i in used if np.isfinite(celsius[:, i]).all()]
    if not steady:
        return None
    values, hours = celsius[:, steady], (times_ns - times_ns[-1]) / 3.6e12
    centred = hours - hours.mean()
    spread = centred @ centred
    slopes = centred @ values / spread
    residuals = values - values.mean(axis=0) - np.outer(centred, slopes)
    errors = np.sqrt((residuals**2).sum(axis=0) / (len(hours) - 2) / spread)
    steps = np.abs(np.diff(values, axis=0))
    jumps = (np.where(steps > STEP_K, steps, 0.0) / np.diff(hours)[:, None]).max(axis=0)
    worst = np.argmax(np.maximum(np.abs(slopes) - 3 * errors, jumps))
    return Drift(SENSORS[steady[worst]], slopes[worst], errors[worst], jumps[worst])


@settings(max_examples=50, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 3 * ROOM),
    apart_s=st.sampled_from([0.05, 0.5, 5.0]),
    used=st.lists(st.sampled_from([0, 1, 2]), unique=True).map(sorted),
)
def test_as_the_formula_over_the_last_minute(
    seed: int, n: int, apart_s: float, used: list[int]
) -> None:
    rng = np.random.default_rng(seed)
    times_ns = 10**15 + np.cumsum(rng.integers(1, round(2 * apart_s * 1e9), n))
    celsius = 20 + np.cumsum(rng.normal(0, 0.03, (n, 3)), axis=0)
    celsius[rng.random(n) < 0.01] += rng.normal(0, 1, 3)
    for column in celsius.T:  # some are heard late
        column[: rng.integers(-20, 20)] = np.nan
    history = RecentReadings(SENSORS)
    for i in range(n):
        history.append(celsius[i].tolist(), int(times_ns[i]))
        if i % 97 and i < n - 1:
            continue
        kept = slice(np.searchsorted(times_ns, times_ns[i] - RATE_OVER_NS), i + 1)
        assert len(history) == kept.stop - kept.start
        found = history.fastest(np.array(used, np.int64))
        expected = plain(times_ns[kept], celsius[kept], used)
        assert (found is None) == (expected is None)
        if found is not None and expected is not None:
            assert found.sensor == expected.sensor
            figures = [found.k_per_h, found.standard_error, found.jump_k_per_h]
            assert figures == pytest.approx(
                [expected.k_per_h, expected.standard_error, expected.jump_k_per_h],
                rel=1e-7, abs=1e-6,
            )  # fmt: skip


def test_a_reading_told_twice_is_no_step() -> None:
    history = RecentReadings(SENSORS)
    for second in (0, 1, 1, 2, 3):
        history.append([20.0 + second * 1e-3] * 3, second * SECOND_NS)
    drift = history.fastest(np.arange(3))
    assert drift is not None
    assert drift.sensor == "t1"
    assert drift.k_per_h == pytest.approx(3.6)
    assert drift.jump_k_per_h == 0.0

"""Unwrapping: turns run on, jumps are told from motion, and only for as long as promised."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armd.drivers.unwrap import SETTLE_SAMPLES, Unwrapper

BITS = 20
TURN = 1 << BITS
MILLISECOND = 1000


def unwrap(raw, t_us=None, invalid=None, unwrapper=None):
    raw = np.asarray(raw, dtype=np.int64).reshape(len(raw), -1) % TURN
    t_us = np.arange(len(raw)) * MILLISECOND if t_us is None else np.asarray(t_us)
    invalid = np.zeros(len(raw), np.uint16) if invalid is None else np.asarray(invalid, np.uint16)
    unwrapper = unwrapper or Unwrapper([TURN] * raw.shape[1], [TURN] * raw.shape[1])
    return unwrapper(raw, t_us, invalid)


@settings(deadline=None)
@given(st.integers(0, TURN - 1), st.lists(st.integers(-3000, 3000), min_size=1, max_size=300))
def test_motion_within_the_rate_is_followed_over_any_number_of_turns(start, steps):
    # 1200 °/s are 3495 counts of 2^20 in a millisecond
    true = start + np.cumsum([0, *steps])
    count, jumped = unwrap(true)
    assert not jumped.any()
    assert np.array_equal(np.diff(count[:, 0]), np.diff(true))
    assert -TURN // 2 <= count[0, 0] < TURN // 2


@settings(deadline=None)
@given(st.integers(5000, TURN - 5000), st.integers(1, 20))
def test_a_single_wrong_reading_costs_one_sample(size, at):
    true = np.arange(30) * 100
    raw = true.copy()
    raw[at] += size
    count, jumped = unwrap(raw)
    assert np.flatnonzero(jumped).tolist() == [at]
    assert np.array_equal(np.delete(count[:, 0], at), np.delete(true, at))


@settings(deadline=None)
@given(st.integers(30000, TURN - 30000), st.integers(1, 20))
def test_a_lasting_step_is_withheld_for_the_jump_and_five_more_at_most(size, at):
    raw = np.arange(40) * 100
    raw[at:] += size
    count, jumped = unwrap(raw)
    bad = np.flatnonzero(jumped)
    assert bad[0] == at and bad[-1] - at <= SETTLE_SAMPLES
    assert np.array_equal(np.diff(count[at + 6 :, 0]), np.full(40 - at - 7, 100))


def test_an_encoder_gone_wild_stays_invalid():
    rng = np.random.default_rng(1)
    raw = np.arange(1000) * 100
    raw[100:900] = rng.integers(0, TURN, 800)
    _, jumped = unwrap(raw)
    assert not jumped[:100].any()
    assert jumped[100:900].mean() > 0.98  # chance hits near the old reading, at first
    assert not jumped[906:].any()


def test_only_the_joint_that_jumps_is_marked():
    raw = np.zeros((20, 3), np.int64)
    raw[7, 1] = TURN // 3
    _, jumped = unwrap(raw)
    assert jumped[7] == 0b010 and np.count_nonzero(jumped) == 1


def test_a_gap_in_time_allows_motion_in_proportion():
    count, jumped = unwrap([0, 100, 200_000], t_us=[0, 1000, 201_000])
    assert not jumped.any() and count[-1, 0] == 200_000
    _, jumped = unwrap([0, 100, 200_000], t_us=[0, 1000, 11_000])
    assert jumped.tolist() == [0, 0, 1]


def test_what_the_arm_calls_invalid_is_no_reading_to_compare_with():
    raw = [0, 100, 400_000, 300, 400]
    _, jumped = unwrap(raw, invalid=[0, 0, 1, 0, 0])
    assert not jumped.any()


def test_an_arm_that_starts_with_an_invalid_joint_takes_the_first_valid_reading():
    count, jumped = unwrap([400_000, 400_000, 7, 8], invalid=[1, 1, 0, 0])
    assert not jumped.any() and count[2:, 0].tolist() == [7, 8]


@pytest.mark.parametrize("split", [1, 3, 7])
def test_chunks_do_not_matter(split):
    rng = np.random.default_rng(2)
    raw = np.cumsum(rng.integers(-3000, 3000, (200, 4)), axis=0)
    raw[50:, 2] += 300_000
    raw[70, 1] += 300_000
    t_us = np.arange(200) * MILLISECOND
    whole = unwrap(raw, t_us)
    unwrapper = Unwrapper([TURN] * 4, [TURN] * 4)
    parts = [
        unwrap(raw[i : i + split], t_us[i : i + split], None, unwrapper)
        for i in range(0, 200, split)
    ]
    for k in range(2):
        assert np.array_equal(np.concatenate([part[k] for part in parts]), whole[k])

"""When a step of a placement can be the artefact's: brute force over all instants."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from armd.compensation.diagnose.search.touched import LEAST_RESTS, LEAST_TARGETS, _possible


def rests(target: list[int], *, timed: bool = True) -> Any:
    n = len(target)
    time_s = np.arange(n, dtype=float) if timed else np.full(n, np.nan)
    states = SimpleNamespace(time_s=time_s)
    return SimpleNamespace(observations=SimpleNamespace(states=states, target=np.array(target)))


@given(st.lists(st.integers(0, 3), min_size=1, max_size=20))
def test_targets_stand_on_both_sides(target: list[int]) -> None:
    wanted = [
        k
        for k in range(LEAST_RESTS, len(target) - LEAST_RESTS + 1)
        if min(len(set(target[:k])), len(set(target[k:]))) >= LEAST_TARGETS
    ]
    assert _possible(rests(target), np.arange(len(target))).tolist() == wanted


def test_nothing_is_told_of_one_seat_after_another_or_without_times() -> None:
    every = np.arange(16)
    assert not len(_possible(rests([0] * 8 + [1] * 8), every))  # Kinova's seats, one by one
    assert len(_possible(rests([0, 1] * 8), every))
    assert not len(_possible(rests([0, 1] * 8, timed=False), every))

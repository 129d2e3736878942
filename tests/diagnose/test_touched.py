"""When a step of a placement can be the artefact's: brute force over all instants."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from armd.compensation.diagnose.search.touched import (
    LEAST_RESTS,
    LEAST_TARGETS,
    _possible,
    borne_by_enough,
)


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


def test_one_gross_error_among_four_rests_moves_no_artefact() -> None:
    """Sixteen rests at three balls, noise 1; a rigid motion of any size before the fifth."""
    rng = np.random.default_rng(4)
    balls = np.array([[0.0, 0.0, 0.0], [60.0, 0.0, 0.0], [20.0, 50.0, 10.0]])[np.arange(16) % 3]
    turned = [np.cross(axis, balls) for axis in np.eye(3)]
    shifted = [np.tile(axis, (16, 1)) for axis in np.eye(3)]
    pose = np.stack([*shifted, *turned], axis=2).reshape(48, 6)
    for _ in range(20):
        noise = rng.normal(size=48)
        moved = noise + pose @ np.array([8.0, -5.0, 9.0, 0.3, 0.2, -0.4]) * (np.arange(48) < 12)
        assert borne_by_enough(pose, moved, 4)
        gross = noise.reshape(16, 3).copy()
        gross[rng.integers(4)] += 40.0 * rng.choice([-1, 1], 3)
        assert not borne_by_enough(pose, gross.ravel(), 4)

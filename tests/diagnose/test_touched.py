"""When a step of a placement can be the artefact's: brute force over all instants."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.constants import LEAST_RESTS_BESIDE, LEAST_TARGETS, TOUCHED_GRID
from armd.compensation.diagnose.diagnosis import MovedArtefact
from armd.compensation.diagnose.fitting.under_test import make_model_and_judge_sessions
from armd.compensation.diagnose.problem.linear import Rests
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.diagnose.search.moved_artefact import (
    _at_the_instant,
    _distance,
    _grid,
    _locate,
    _possible,
    find_moved_artefacts,
    split_placements,
)
from armd.compensation.diagnose.search.search import Search
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.setup.artefact_moved import make_candidate
from armd.compensation.effects.setup.mount_drift import MOST_MOUNT_STEP
from armd.compensation.estimate.noise.robust import WINSOR_AT, compute_huber_loss
from support import synthetic
from support.selection import parametrize_default
from support.small_fit import candidate

ARM = synthetic.arm()


def rests(target: list[int], *, timed: bool = True) -> Any:
    n = len(target)
    time_s = np.arange(n, dtype=float) if timed else np.full(n, np.nan)
    states = SimpleNamespace(time_s=time_s)
    still = np.zeros(len(target), dtype=bool)
    observations = SimpleNamespace(states=states, target=np.array(target), turned=still)
    return SimpleNamespace(observations=observations)


@given(st.lists(st.integers(0, 3), min_size=1, max_size=20))
def test_targets_stand_on_both_sides(target: list[int]) -> None:
    wanted = [
        k
        for k in range(LEAST_RESTS_BESIDE, len(target) - LEAST_RESTS_BESIDE + 1)
        if min(len(set(target[:k])), len(set(target[k:]))) >= LEAST_TARGETS
    ]
    assert _possible(rests(target), np.arange(len(target))).tolist() == wanted


def test_nothing_is_told_of_one_seat_after_another_or_without_times() -> None:
    every = np.arange(16)
    assert not len(_possible(rests([0] * 8 + [1] * 8), every))  # Kinova's seats, one by one
    assert len(_possible(rests([0, 1] * 8), every))
    assert not len(_possible(rests([0, 1] * 8, timed=False), every))


def test_few_instants_are_tried_all_and_many_evenly() -> None:
    assert _grid(np.array([4, 7, 9])) == [4, 7, 9]
    tried = _grid(np.arange(100, 500))
    assert len(tried) == TOUCHED_GRID and tried[0] == 100 and tried[-1] == 499
    assert np.ptp(np.diff(tried)) <= 1
    assert _grid(np.zeros(0, np.int64)) == []


def test_a_pose_beside_gross_errors_is_where_hubers_loss_is_least() -> None:
    rng = np.random.default_rng(7)
    pose = rng.normal(size=(60, 6))
    left = pose @ rng.normal(size=6) + rng.normal(size=60)
    left[:6] += 60.0

    def loss(solution: np.ndarray) -> float:
        size = np.linalg.norm((left - pose @ solution).reshape(-1, 3), axis=1)
        within = np.minimum(size, WINSOR_AT)
        return float((within * (size - 0.5 * within)).sum())

    best = minimize(loss, np.zeros(6), method="BFGS", options={"gtol": 1e-8})
    assert compute_huber_loss(_distance(pose, left)) == pytest.approx(best.fun, rel=1e-4)
    expected = np.linalg.norm((left - pose @ best.x).reshape(-1, 3), axis=1)
    assert _distance(pose, left) == pytest.approx(expected, abs=0.02)


def test_a_placement_is_parted_at_its_row_and_nothing_else_is() -> None:
    """Rows of one placement, not in the order of time; two of them are one rest."""
    rng = np.random.default_rng(1)
    arm = synthetic.arm()
    first, second = (
        synthetic.session(arm, arm.nominal(), rng, readings=8, placements=2, name=name)
        for name in ("one", "two")
    )
    # Of the second session's placement 1, rows 1, 3, 5, 7: the last row was measured first.
    time_s = second.states.time_s.copy()
    time_s[7] = time_s[0] - 60.0
    states = replace(second.states, time_s=time_s)
    second = replace(second, states=states, row=np.arange(8) + 2)
    rest_of = np.array([*range(8), 8, 9, 10, 11, 12, 11, 13, 14])  # rows 3 and 5 are a rest
    kept = np.array([*range(13), 14, 15])
    gathered = SimpleNamespace(
        placement=np.concatenate([first.placement, 2 + second.placement])[kept],
        session=np.repeat([0, 1], 8)[kept],
        session_names=["one", "two"],
        placement_names=["one/P0", "one/P1", "two/P0", "two/P1"],
        states=SimpleNamespace(time_s=np.concatenate([first.states.time_s, time_s])[kept]),
    )
    of: Any = SimpleNamespace(
        observations=gathered,
        n=15,
        sessions=(first, second),
        rest_of=rest_of,
        point_of=np.arange(15),
    )
    of.in_order = Rests.in_order.func(of)
    # In time: row 7, row 1, rows 3 and 5; a step after two of these rests.
    name, placement, row, instant = _locate(make_candidate(3, 2), of)
    assert (name, placement) == ("two", "P1")
    assert row == 3 + 2 + 1  # as the file counts it, from 1
    assert instant == (time_s[1] + time_s[3]) / 2
    moves: list[Any] = [SimpleNamespace(candidate=make_candidate(3, k)) for k in (2, 1)]
    same, once = split_placements(of, moves[:1])
    assert same is first
    assert once.placement.tolist() == [0, 1, 0, 2, 0, 2, 0, 1]
    assert once.placement_names == ["P0", "P1", "P1 (moved)"]
    _, twice = split_placements(of, moves)
    assert twice.placement.tolist() == [0, 2, 0, 3, 0, 3, 0, 1]
    assert twice.placement_names == ["P0", "P1", "P1 (moved)", "P1 (moved) (moved)"]


def step(cause: str, joint: int, at: float, finer: float | None = None) -> Candidate:
    """A step at an instant, s; *finer*: what lies between the grid's."""
    of = replace(candidate(cause, joint), setting=(("instant", at, "s"),))
    if finer is None:
        return of
    return replace(of, refine=lambda: [step(cause, joint, finer)])


def test_of_each_rival_the_step_nearest_to_the_instant_is_compared() -> None:
    time_s = 10.0 * np.arange(12.0)
    observations = SimpleNamespace(
        placement=np.zeros(12, np.int64), states=SimpleNamespace(time_s=time_s)
    )
    every = [
        step("encoder_slip", 1, 20.0), step("encoder_slip", 1, 70.0, finer=56.0),
        step("encoder_slip", 2, 40.0), candidate("encoder_scale", 3),
        step("mount_drift", 1, 60.0),
    ]  # fmt: skip
    of: Any = SimpleNamespace(observations=observations, point_of=np.arange(12))
    of.in_order = Rests.in_order.func(of)
    found = _at_the_instant(make_candidate(0, 6), every, of)  # between 50 and 60 s
    assert [(c.cause, str(c.location), c.setting[0][1]) for c in found] == [
        ("encoder_slip", "joint 1", 56.0),
        ("encoder_slip", "joint 2", 40.0),
        ("mount_drift", "joint 1", 60.0),
    ]
    # A mount that steps farther is an artefact that was moved.
    assert [c.columns[0].reach for c in found] == [np.inf, np.inf, MOST_MOUNT_STEP]


def shaken(seed: int, moved_mm: float = 0.0) -> list[Session]:
    """Five sessions of an ideal arm, in the third of which points scatter five times as much; in
    the fifth, the artefact is moved half-way through a placement."""
    rng = np.random.default_rng(seed)
    sessions = [
        synthetic.session(
            ARM, ARM.nominal(), rng, targets=5, placements=2, readings=50, encoder_rad=3e-6,
            noise_mm=0.02 if k == 2 else 0.004, name=f"session-{k + 1}",
        )
        for k in range(5)
    ]  # fmt: skip
    started = [replace(s, states=replace(s.states, time_s=s.states.time_s + 3600.0 * k))
               for k, s in enumerate(sessions)]  # fmt: skip
    last = started[-1]
    later = (last.placement == 0) & (np.arange(last.n) >= last.n // 2)
    truth = last.truth_mm + moved_mm * later[:, None] * np.array([0.6, 0.0, 0.8])
    return [*started[:-1], replace(last, truth_mm=truth)]


def find_moves(sessions: list[Session]) -> list[MovedArtefact]:
    baseline = make_model_and_judge_sessions(sessions, ARM, None)[0]
    search = Search(collect_rests(sessions, ARM), ARM, baseline)
    return find_moved_artefacts(search.first_fit, search.survey)[0]


@pytest.mark.slow
@parametrize_default("seed", range(4))
def test_a_session_that_scatters_more_moves_no_artefact(seed: int) -> None:
    assert find_moves(shaken(seed)) == []


@pytest.mark.slow
def test_what_was_moved_is_found_beside_a_session_that_scatters_more() -> None:
    (found,) = find_moves(shaken(1, moved_mm=0.15))
    assert (found.session, found.placement) == ("session-5", "P0")


@pytest.mark.slow
def test_all_moves_are_found_in_one_fit_the_small_one_beside_the_large() -> None:
    sessions = shaken(1, moved_mm=0.5)
    first = sessions[0]
    later = (first.placement == 1) & (np.arange(first.n) >= 3 * first.n // 4)
    truth = first.truth_mm + 0.06 * later[:, None] * np.array([0.0, 0.6, 0.8])
    found = find_moves([replace(first, truth_mm=truth), *sessions[1:]])
    assert [(move.session, move.placement) for move in found] == [
        ("session-5", "P0"), ("session-1", "P1"),
    ]  # fmt: skip

"""Copies of a posture: which they are, how much they count, and what they share."""

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.estimate.folds import make_placement_folds
from armd.compensation.estimate.noise.postures import compute_counts, estimate_shared_part
from armd.compensation.estimate.observations import Observations, collect_observations
from support import synthetic


def copied(times: int, scatter_rad: float = 1e-4, in_rounds: bool = False) -> Observations:
    """Twenty postures, each so many times: one after another, or in rounds."""
    arm, rng = synthetic.arm(), np.random.default_rng(7)
    one = synthetic.session(arm, synthetic.disturbed(arm, rng, 0.3), rng, readings=20)
    rows = np.tile(np.arange(20), times) if in_rounds else np.repeat(np.arange(20), times)
    session = one.rows(rows)
    moved = session.states.q + rng.uniform(-scatter_rad, scatter_rad, session.states.q.shape)
    return collect_observations([replace(session, states=replace(session.states, q=moved))], arm)


@pytest.mark.parametrize("in_rounds", [False, True])
def test_copies_are_one_posture(in_rounds: bool) -> None:
    observations = copied(3, in_rounds=in_rounds)
    expected = np.tile(np.arange(20), 3) if in_rounds else np.repeat(np.arange(20), 3)
    np.testing.assert_array_equal(observations.posture, expected)
    assert observations.n_postures == 20


def test_another_placement_is_another_posture_and_so_are_angles_further_apart() -> None:
    observations = copied(2)
    second = np.arange(observations.n) % 2
    elsewhere = replace(observations, placement=observations.placement + 100 * second)
    assert elsewhere.n_postures == 40
    assert copied(2, 0.1).n_postures == 40


def test_copies_on_no_two_sides_of_a_fold() -> None:
    """Of one placement, postures are left out in turn, each with all its copies."""
    observations = copied(3)
    one = replace(observations, placement=np.zeros_like(observations.placement))
    posture = one.posture
    folds, by = make_placement_folds(one)
    assert by == "posture" and len(folds) == 8
    for out in folds:
        assert not set(posture[out]) & set(posture[~out])


@pytest.mark.parametrize("part", [0.0, 0.3, 0.9, 1.0])
def test_the_shared_part_of_an_error_is_found(part: float) -> None:
    rng, posture = np.random.default_rng(3), np.repeat(np.arange(4000), 3)
    shared = rng.normal(size=(4000, 3))[posture]
    white = np.sqrt(part) * shared + np.sqrt(1.0 - part) * rng.normal(size=(12000, 3))
    assert estimate_shared_part(white, posture) == pytest.approx(part, abs=0.02)


@pytest.mark.parametrize("part", [0.0, 0.4, 1.0])
def test_copies_count_as_their_mean_is_known(part: float) -> None:
    """By the variance of a mean of equally correlated readings."""
    posture = np.array([0, 0, 0, 1, 2, 2])
    told = compute_counts(posture, part)
    for number in range(3):
        m = int((posture == number).sum())
        covariance = (1.0 - part) * np.eye(m) + part
        known = 1.0 / (np.ones(m) @ covariance @ np.ones(m) / m**2)
        assert told[posture == number].sum() == pytest.approx(known)

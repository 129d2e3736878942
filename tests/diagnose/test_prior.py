"""Priors: shared out by cause, place, kind and value; one value more makes no other improbable."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.diagnose.constants import EXPECTED_PRIOR, UNKNOWN_PRIOR
from armd.compensation.diagnose.problem.signatures import identify_kind
from armd.compensation.diagnose.scoring.prior import compute_log_prior, find_log_prior
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Candidate
from support.small_fit import candidate

DISC, OTHER_DISC = (candidate("encoder_eccentricity", joint) for joint in (1, 2))
SAG = candidate("joint_compliance", 2)
NAMELESS = candidate("unknown", 2)


def log_prior_of(candidates: list[Candidate], absorbed: tuple[int, ...] = ()) -> np.ndarray:
    freedom = np.array([int(i not in absorbed) for i in range(len(candidates))])
    kinds = [identify_kind(one) for one in candidates]
    return compute_log_prior(kinds, freedom, np.zeros(len(candidates), dtype=bool))


def test_a_cause_has_its_share_and_its_places_divide_it() -> None:
    share = np.exp(log_prior_of([DISC, OTHER_DISC, SAG, NAMELESS]))
    named = (1.0 - UNKNOWN_PRIOR) / 2
    assert share == pytest.approx([named / 2, named / 2, named, UNKNOWN_PRIOR])


def test_what_is_absorbed_takes_no_part() -> None:
    log_prior = log_prior_of([DISC, OTHER_DISC, SAG, NAMELESS], absorbed=(1,))
    assert log_prior[1] == -np.inf
    assert np.exp(log_prior[0]) == pytest.approx((1.0 - UNKNOWN_PRIOR) / 2)


def test_the_values_of_a_grid_share_one_kind() -> None:
    share = np.exp(log_prior_of([DISC, *[SAG] * 40]))
    assert share[0] == pytest.approx(share[1:].sum())


def test_a_rare_cause_is_a_tenth_as_probable_as_a_common_one() -> None:
    share = np.exp(log_prior_of([SAG, candidate("gear_mesh", 2)]))
    assert share[1] == pytest.approx(CATALOGUE["gear_mesh"].commonness * share[0])
    assert share[1] == pytest.approx(0.1 * share[0])


def test_what_every_arm_may_have_is_there_as_likely_as_not() -> None:
    kinds = [identify_kind(one) for one in (DISC, SAG, SAG)]
    expected = np.array([False, True, True])
    share = np.exp(compute_log_prior(kinds, np.ones(3, dtype=int), expected))
    assert share[1:] == pytest.approx([EXPECTED_PRIOR / 2, EXPECTED_PRIOR / 2])


def test_a_finding_has_the_prior_of_its_kind_and_else_the_least_of_its_cause() -> None:
    kinds = [identify_kind(one) for one in (DISC, OTHER_DISC, SAG)]
    log_prior = np.log([0.2, 0.1, 0.5])

    def find_of(cause: str, joint: int) -> float:
        return find_log_prior(identify_kind(candidate(cause, joint)), kinds, log_prior)

    assert find_of("encoder_eccentricity", 1) == np.log(0.2)
    assert find_of("encoder_eccentricity", 3) == np.log(0.1)
    assert find_of("gear_mesh", 3) == np.log(UNKNOWN_PRIOR)

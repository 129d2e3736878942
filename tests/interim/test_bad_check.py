"""The evidence that a check is off by itself: by densities of all numbers, written out in full."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_t
from test_interim_evidence import a_stack

from armd.compensation.interim.evidence.bad_check import (
    ELSEWHERE_MM,
    GRAINS_MM,
    ONE_IN,
    SCATTERS,
    OtherChecks,
    find_spoilt,
)
from armd.compensation.interim.evidence.likelihood import NOISE_WEIGHT
from armd.compensation.interim.evidence.stack import Stack

TARGETS = 2


def touched(seed: int) -> Stack:
    """Checks on two targets, which move their numbers by a few units a hundredth of a mm."""
    rng = np.random.default_rng(seed)
    of, _ = a_stack(rng)
    targets = tuple(100.0 * rng.normal(size=(len(z), 3 * TARGETS)) for z in of.residual)
    return replace(of, targets=targets)


def density(of: Stack, more: np.ndarray) -> float:
    """Log of Student's density of all numbers, *more* added to the last check's covariance."""
    z, known = np.concatenate(of.residual), np.concatenate(of.error_columns)
    shape = np.eye(len(z)) + known @ known.T
    r = len(of.residual[-1])
    shape[-r:, -r:] += more
    return float(multivariate_t.logpdf(z, np.zeros(len(z)), shape, df=NOISE_WEIGHT))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("check", [0, 3])
def test_the_evidence_is_a_ratio_of_densities(seed: int, check: int) -> None:
    of = touched(seed)
    kept = [0, 1, 3, 4]  # one is left out already
    last = of.select_checks([*(i for i in kept if i != check), check])
    moves = of.targets[check]
    r = len(moves)
    by_target = [moves[:, 3 * t : 3 * t + 3] for t in range(TARGETS)]
    families = (
        [(s**2 - 1.0) * np.eye(r) for s in SCATTERS],
        [(size**2) * one @ one.T for one in by_target for size in GRAINS_MM],
        [(size**2) * moves @ moves.T for size in ELSEWHERE_MM],
    )
    each = [
        logsumexp([density(last, more) for more in family]) - np.log(len(family))
        for family in families
    ]
    expected = logsumexp(each) - np.log(len(each)) - density(last, np.zeros((r, r)))
    assert OtherChecks(of, of.sum_checks(kept)).log_evidence(check) == pytest.approx(
        expected, abs=1e-8
    )


def test_the_worst_goes_first_and_what_it_had_hidden_next() -> None:
    rng = np.random.default_rng(5)
    n, rows = 12, 9
    grain = 0.3 * rng.normal(size=3)
    targets = tuple(100.0 * rng.normal(size=(rows, 3)) for _ in range(n))
    residual = [rng.normal(size=rows) for _ in range(n)]
    residual[4] = residual[4] + targets[4] @ grain  # dirt in the seat: about 30 units a number
    residual[7] = 6.0 * residual[7]  # a hand that was not steady
    known = tuple(0.1 * rng.normal(size=(rows, 2)) for _ in range(n))
    nothing = tuple(np.zeros((rows, 0)) for _ in range(n))
    of = Stack(np.arange(float(n)), tuple(residual), nothing, known, targets, ())
    odds = find_spoilt(of, of.sum_checks(range(n)), range(n))
    assert list(odds) == [4, 7]
    first = OtherChecks(of, of.sum_checks(range(n)))
    assert odds[4] == first.log_evidence(4) - np.log(ONE_IN)
    # Beside the grain, the noise looked as large as the unsteady hand's.
    assert first.log_evidence(7) < odds[7] + np.log(ONE_IN)
    good = of.sum_checks([i for i in range(n) if i not in odds])
    assert find_spoilt(of, good, [0, 1, 2]) == {}
    assert (
        find_spoilt(of, of.sum_checks(range(n)), [0, 1]) == {}
    )  # only who is doubted can be found

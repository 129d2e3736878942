"""A step half-way: against two-sample tests at every place where it may be."""

import numpy as np
import pytest
from scipy.stats import f as f_distribution

from armd.compensation.diagnose.constants import LEAST_PART
from armd.compensation.diagnose.fitting.target_steps import TargetStep, select_significant_steps
from armd.compensation.diagnose.fitting.target_steps import _clearest_step as clearest_step


def brute_force(own: np.ndarray) -> tuple[float, int, float]:
    best = (0.0, 0, 1.0)
    for after in range(LEAST_PART, len(own) - LEAST_PART + 1):
        first, rest = own[:after], own[after:]
        apart = rest.mean(axis=0) - first.mean(axis=0)
        within = sum(float(((part - part.mean(axis=0)) ** 2).sum()) for part in (first, rest))
        freedom = 3 * (len(own) - 2)
        between = len(first) * len(rest) / len(own) * float(apart @ apart)
        p = float(f_distribution.sf((between / 3) / (within / freedom), 3, freedom))
        if p < best[2]:
            best = (float(np.linalg.norm(apart)), after, p)
    return best


def test_the_clearest_step_is_that_of_all_two_sample_tests() -> None:
    own = np.random.default_rng(1).normal(size=(30, 3))
    own[18:] += [0.0, 6.0, 0.0]
    size, after, p = brute_force(own)
    assert after == 18
    found = clearest_step(own)
    assert found[:2] == (pytest.approx(size), after)
    assert found[2] == pytest.approx(p * (30 - 2 * LEAST_PART + 1))


def test_noise_makes_a_step_no_oftener_than_is_said() -> None:
    rng = np.random.default_rng(2)
    chances = np.array([clearest_step(rng.normal(size=(20, 3)))[2] for _ in range(1500)])
    assert (chances < 0.05).mean() <= 0.05


def test_too_few_rests_show_no_step_and_a_single_target_is_for_the_search() -> None:
    assert clearest_step(np.zeros((2 * LEAST_PART - 1, 3))) == (0.0, 0, 1.0)
    clear = TargetStep("P1", "S1", 30, 5.0, 9.0, 12, 1e-9)
    other = TargetStep("P1", "S2", 30, 1.0, 0.1, 12, 0.4)
    assert select_significant_steps([clear]) == []
    assert select_significant_steps([clear, other]) == [clear]

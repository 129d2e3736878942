"""Sets of causes weighed as a whole: against the normal densities themselves."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from armd.compensation.diagnose.search import revisit, search
from armd.compensation.effects.effect import SCALES
from armd.compensation.effects.encoder import encoder_periodic
from support.small_fit import candidate, small_fit

N = 12


def log_density_ratio(columns: np.ndarray, size: np.ndarray, residual: np.ndarray) -> float:
    """Of a residual with amplitudes normal of a *size* (m,) against unit noise alone."""
    wide = np.eye(len(residual)) + columns @ np.diag(size**2) @ columns.T
    some = multivariate_normal(cov=wide).logpdf(residual)
    return float(some - multivariate_normal(cov=np.eye(len(residual))).logpdf(residual))


def test_the_evidence_of_a_set_is_that_of_the_normal_densities() -> None:
    rng = np.random.default_rng(61)
    columns, residual = rng.normal(size=(3 * N, 4)), 2.0 * rng.normal(size=3 * N)
    size = np.array([0.3, 1.0, 5.0, 2.0])
    gram, side = columns.T @ columns, columns.T @ residual
    for m in (1, 3, 4):
        expected = log_density_ratio(columns[:, :m], size[:m], residual)
        assert revisit._log_evidence(gram, side, size[:m] ** 2) == pytest.approx(expected)
    assert revisit._log_evidence(gram, side, np.empty(0)) == 0.0


def test_an_amplitude_is_of_the_likeliest_scale_and_a_large_one_costs_its_prior() -> None:
    """Of a typical size, five, and fifty times that: the density of normals of these widths."""
    small, large = candidate("a", 1, typical=2.0), candidate("b", 2, widths=2, typical=2.0)
    fitted = small_fit(
        np.zeros(3 * N),
        np.ones((3 * N, 1)),
        {small: np.ones((3 * N, 1)), large: np.ones((3 * N, 2))},
    )
    object.__setattr__(fitted, "amplitudes", (np.array([1.5]), np.array([60.0, 80.0])))
    variance, log_prior = revisit._amplitudes_a_priori(fitted)
    np.testing.assert_allclose(variance, [2.0**2, 100.0**2, 100.0**2])
    assert log_prior == pytest.approx(math.log(SCALES[1.0]) + math.log(SCALES[50.0]))


def test_of_a_curve_one_order_may_stand_where_it_does_and_nothing_else_of_its_place() -> None:
    facts: Any = SimpleNamespace(joints=(2, 3))
    of_place = [c for c in encoder_periodic.candidates(facts) if c.location.joint == 3]
    elsewhere = next(c for c in encoder_periodic.candidates(facts) if c.location.joint == 2)
    curve = next(c for c in of_place if c.setting[0] == ("highest order", 8.0, "1/turn"))
    able = [c.setting[0] for c in of_place if not revisit._again(c, curve)]
    assert able == [("order", float(k), "1/turn") for k in range(3, 9)]
    assert not revisit._again(elsewhere, curve)
    one = next(c for c in of_place if c.setting[0] == ("order", 3.0, "1/turn"))
    assert all(revisit._again(c, one) for c in of_place)


def test_a_set_says_more_that_leaves_less_without_a_name_or_tells_all_there_is() -> None:
    gain, disc, nameless = (candidate(cause, 2) for cause in ("gain", "disc", "unknown"))
    elsewhere = candidate("unknown", 3)
    current: Any = SimpleNamespace(findings=(gain, nameless))
    more = {
        (gain, disc): True,
        (disc,): True,
        (gain, nameless, disc): True,
        (disc, nameless): False,
        (gain, elsewhere): False,
        (gain, nameless, elsewhere): True,
    }
    assert {one: search._says_more(one, current) for one in more} == more

"""A set of causes weighed as a whole: against the normal densities themselves."""

import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from armd.compensation.diagnose.search import set_posterior
from armd.compensation.effects.sizes import SCALES
from support.small_fit import candidate, small_fit

N = 12


def log_density_ratio(columns: np.ndarray, size: np.ndarray, residual: np.ndarray) -> float:
    """Of a residual with amplitudes normal of a *size* (m,) against unit noise alone."""
    wide = np.eye(len(residual)) + columns @ np.diag(size**2) @ columns.T
    with_amplitudes = multivariate_normal(cov=wide).logpdf(residual)
    return float(with_amplitudes - multivariate_normal(cov=np.eye(len(residual))).logpdf(residual))


def test_the_evidence_of_a_set_is_that_of_the_normal_densities() -> None:
    rng = np.random.default_rng(61)
    columns, residual = rng.normal(size=(3 * N, 4)), 2.0 * rng.normal(size=3 * N)
    size = np.array([0.3, 1.0, 5.0, 2.0])
    gram, side = columns.T @ columns, columns.T @ residual
    for m in (1, 3, 4):
        expected = log_density_ratio(columns[:, :m], size[:m], residual)
        assert set_posterior._log_evidence(gram, side, size[:m] ** 2) == pytest.approx(expected)
    assert set_posterior._log_evidence(gram, side, np.empty(0)) == 0.0


def test_an_amplitude_is_of_the_likeliest_scale_and_a_large_one_costs_its_prior() -> None:
    """Of a typical size, or fifty times that: the density of normals of these widths."""
    small, large = candidate("a", 1, typical=2.0), candidate("b", 2, widths=2, typical=2.0)
    fitted = small_fit(
        np.zeros(3 * N),
        np.ones((3 * N, 1)),
        {small: np.ones((3 * N, 1)), large: np.ones((3 * N, 2))},
    )
    object.__setattr__(fitted, "amplitudes", (np.array([1.5]), np.array([60.0, 80.0])))
    variance, log_prior = set_posterior._amplitudes_a_priori(fitted)
    np.testing.assert_allclose(variance, [2.0**2, 100.0**2, 100.0**2])
    assert log_prior == pytest.approx(math.log(SCALES[1.0]) + math.log(SCALES[50.0]))

"""Evidence against a brute-force integral, scores against dense least squares, priors by count."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import logsumexp
from scipy.stats import chi2, norm

from armd.compensation.diagnose.scoring.evidence import add_sums, estimate_amplitudes, score
from armd.compensation.effects.sizes import SCALES
from support.small_sums import TYPICAL, N, problem, sums_of


def clear(b: np.ndarray, columns: np.ndarray) -> np.ndarray:
    return columns - b @ np.linalg.lstsq(b, columns, rcond=None)[0]


def test_scores_and_estimates_are_those_of_dense_least_squares() -> None:
    b, x, r = problem()
    sums = sums_of(b, x, r, np.full(4, np.inf))
    scores, found = score(sums), estimate_amplitudes(sums)
    for i, own in enumerate((slice(0, 1), slice(1, 3), slice(3, 4))):
        columns, left = clear(b, x[:, own]), clear(b, r)
        amplitude = np.linalg.lstsq(columns, left, rcond=None)[0]
        gained = left @ left - np.sum((left - columns @ amplitude) ** 2)
        assert scores.statistic[i] == pytest.approx(gained)
        assert scores.freedom[i] == columns.shape[1]
        assert scores.log_p[i] == pytest.approx(chi2.logsf(gained, columns.shape[1]))
        np.testing.assert_allclose(found[i], -amplitude)


def test_a_shared_column_with_a_variance_is_noise_that_rows_share() -> None:
    b, x, r = problem()
    variance = np.array([0.5, 2.0, 1e-3, 7.0])
    inverse = np.linalg.inv(np.eye(N) + b @ np.diag(variance) @ b.T)
    own = x[:, 1:3]
    side = own.T @ inverse @ r
    expected = side @ np.linalg.solve(own.T @ inverse @ own, side)
    assert score(sums_of(b, x, r, variance)).statistic[1] == pytest.approx(expected)


def test_the_evidence_is_the_integral_over_the_amplitude() -> None:
    b, x, r = problem()
    left, column = clear(b, r), clear(b, x[:, :1])[:, 0]

    def likelihood(amplitude: float) -> float:
        change = (left - amplitude * column) @ (left - amplitude * column) - left @ left
        return float(np.exp(-0.5 * change))

    best = float(column @ left / (column @ column))
    expected = 0.0

    def integrand(amplitude: float, size: float) -> float:
        return likelihood(amplitude) * float(norm.pdf(amplitude, 0.0, size))

    for scale, share in SCALES.items():
        size = scale * TYPICAL[0]
        points = [best, 0.0]
        value, _ = quad(integrand, best - 3, best + 3, (size,), points=points, limit=500)
        expected += share * value
    scores = score(sums_of(b, x, r, np.full(4, np.inf)))
    assert scores.log_evidence[0] == pytest.approx(np.log(expected), abs=1e-5)


def test_what_absorbs_entirely_leaves_nothing_to_find_until_it_is_taken_out() -> None:
    b, x, r = problem()
    x[:, 3] = b[:, 2] * 5.0
    sums = sums_of(b, x, r, np.full(4, np.inf))
    scores = score(sums)
    assert scores.freedom[2] == 0 and scores.log_p[2] == 0.0
    assert scores.log_evidence[2] == -np.inf
    assert score(sums, without=[2]).freedom[2] == 1


def test_posteriors_share_by_cause_then_place_and_the_unknown_gets_its_twentieth() -> None:
    rng = np.random.default_rng(3)
    b, x = rng.normal(size=(N, 4)), rng.normal(size=(N, 4))
    flat = score(sums_of(b, x, np.zeros(N), np.full(4, np.inf)))
    log_prior = flat.log_posterior() - flat.log_evidence
    share = np.exp(log_prior - log_prior.max())
    np.testing.assert_allclose(share / share.sum(), [0.475, 0.475, 0.05])


def test_sums_of_parts_are_the_sums_of_all() -> None:
    b, x, r = problem()
    variance = np.array([np.inf, 1.0, 1.0, np.inf])
    parts = [sums_of(b[rows], x[rows], r[rows], variance) for rows in (slice(0, 30), slice(30, N))]
    np.testing.assert_allclose(
        score(add_sums(parts)).statistic, score(sums_of(b, x, r, variance)).statistic
    )


def test_a_place_is_as_probable_as_its_candidates_together_however_improbable() -> None:
    """Logarithms throughout: 1e-300 is not the least that a place may have."""
    b, x, r = problem()
    x[:, 3] = b[:, 2] * 5.0  # absorbed: a place of it alone has no probability
    scores = score(sums_of(b, x, r, np.full(4, np.inf)))
    assert len({c.place for c in scores.signatures.candidates}) > 1
    far = replace(scores, log_evidence=scores.log_evidence - np.array([0.0, 5000.0, 0.0]))
    for some in (scores, far):
        log_places = some.log_places()
        for place, log in log_places.items():
            own = [c.place == place for c in some.signatures.candidates]
            assert log == pytest.approx(logsumexp(some.log_posterior()[own]))
        assert logsumexp(list(log_places.values())) == pytest.approx(0.0, abs=1e-12)
    assert min(log for log in far.log_places().values() if np.isfinite(log)) < -4000.0

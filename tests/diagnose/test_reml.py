"""Variances by restricted likelihood, against dense matrices; sums by placement; clipping."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.arrays import F64
from armd.compensation.diagnose.noise import variances as noise_model
from armd.compensation.diagnose.noise.likelihood import Absorbing, Restricted
from armd.compensation.estimate.linear.blocks import to_blocks
from support.small_fit import unit_noise

N = 12


def linear(seed: int = 1, n: int = N, placements: int = 3) -> Any:
    rng = np.random.default_rng(seed)
    distances = SimpleNamespace(standard_uncertainty_mm=np.array([0.5, 2.0]))
    observations = SimpleNamespace(
        placement=np.arange(n) % placements, distances=distances, turned=np.zeros(n, dtype=bool)
    )
    return SimpleNamespace(
        rests=SimpleNamespace(n=n, observations=observations, posture=np.arange(n)),
        normal=None,
        joints=rng.normal(size=(n, 3, 4)) * 300.0,
    )


def columns_of(problem: Any, seed: int = 2) -> np.ndarray:
    """Two columns that absorb freely, in one placement each, and three that rests share."""
    n = problem.rests.n
    found = np.random.default_rng(seed).normal(size=(3 * n + 2, 5))
    for i in range(2):
        elsewhere = np.repeat(problem.rests.observations.placement != i, 3)
        found[: 3 * n][elsewhere, i] = 0.0
    found[3 * n :, :2] = 0.0
    return found


def test_products_by_placement_are_those_of_all_rows() -> None:
    problem = linear()
    columns = columns_of(problem)
    residual = np.random.default_rng(3).normal(size=len(columns))
    whitener = np.random.default_rng(4).normal(size=(N, 3, 3))
    distance = np.array([0.5, 2.0])
    found = to_blocks([columns], problem.rests.observations.placement).products(
        whitener, distance, residual
    )
    both = np.column_stack([columns, residual])
    white = np.vstack(
        [
            (whitener @ both[: 3 * N].reshape(N, 3, -1)).reshape(3 * N, -1),
            both[3 * N :] / distance[:, None],
        ]
    )
    np.testing.assert_allclose(found, white.T @ white, atol=1e-12)


#: Placements in which each column is not zero, and the variance of its amplitude (inf: it absorbs
#: freely, NaN: the drift's).
STRUCTURES = {
    "all hang together": [((0,), np.inf), ((1,), np.inf), *[((0, 1, 2), v) for v in (0.3, np.nan)]],
    "a pose and a drift in each of five, and a border": [
        *(((p,), v) for p in range(5) for v in (np.inf, np.inf, np.nan, np.nan)),
        *((tuple(range(5)), v) for v in (np.inf, np.inf, 0.5, 2.0)),
    ],
    "no drift": [((0,), np.inf), ((1,), np.inf), ((0, 1, 2), 0.3), ((0, 1, 2), np.inf)],
}


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("share", [0.1, 0.7])
def test_the_restricted_likelihood_is_that_of_dense_matrices(share: float, structure: str) -> None:
    """Up to a constant: differences between two sets of variances are compared."""
    where, variances = zip(*STRUCTURES[structure], strict=True)
    variance, placements = np.array(variances), max(map(max, where)) + 1
    n = 6 * placements
    problem = linear(n=n, placements=placements)
    placement = problem.rests.observations.placement
    columns = np.random.default_rng(2).normal(size=(3 * n + 2, len(where)))
    for j, own in enumerate(where):
        columns[: 3 * n][~np.repeat(np.isin(placement, own), 3), j] = 0.0
    columns[3 * n :, [len(own) == 1 for own in where]] = 0.0
    residual = np.random.default_rng(5).normal(size=len(columns))
    distance = problem.rests.observations.distances.standard_uncertainty_mm
    # A scale is common to all rows: the lengths' own is taken along by it.
    whitener = noise_model._unit_whitener(problem, share)
    blocks = to_blocks([columns], placement)
    products = blocks.products(whitener, distance, residual)
    absorbing = Absorbing.from_meeting(blocks.meeting, variance)
    known = Restricted.from_products(products, absorbing, len(residual))
    free, shared = columns[:, np.isinf(variance)], columns[:, ~np.isinf(variance)]
    assert known.freedom == len(residual) - free.shape[1]

    def dense(scale: float, drift: float) -> float:
        covariance = np.zeros((len(residual),) * 2)
        for i, block in enumerate(noise_model._covariance(problem, share)):
            covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
        covariance[3 * n :, 3 * n :] = np.diag(distance**2)
        own = np.where(np.isnan(variance), drift**2, variance)[~np.isinf(variance)]
        covariance = scale**2 * covariance + shared @ np.diag(own) @ shared.T
        inverse = np.linalg.inv(covariance)
        normal = free.T @ inverse @ free
        left = inverse - inverse @ free @ np.linalg.solve(normal, free.T @ inverse)
        logs = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1]
        return float(logs + residual @ left @ residual)

    for one, other in (((0.8, 0.3), (1.7, 5.0)), ((0.8, 0.3), (0.8, 1e-3)), ((0.01, 9.0), (1, 1))):
        difference = known.negative_log_likelihood(*one) - known.negative_log_likelihood(*other)
        assert difference == pytest.approx(dense(*one) - dense(*other), rel=1e-8)


def test_the_noise_of_many_rests_is_found() -> None:
    n, scale, share = 1500, 0.02, 0.6
    problem = linear(7, n, 10)
    problem.rests.observations.distances.standard_uncertainty_mm = np.zeros(0)
    rng = np.random.default_rng(8)
    root = np.linalg.cholesky(noise_model._covariance(problem, share))
    residual = scale * (root @ rng.normal(size=(n, 3, 1))).ravel()
    nothing = to_blocks([np.zeros((3 * n, 0))], problem.rests.observations.placement)
    found = noise_model.estimate(problem, residual, nothing, np.zeros(0))
    assert found.scale_mm == pytest.approx(scale, rel=0.05)
    assert found.encoder_share == pytest.approx(share, abs=0.05)
    assert found.encoder_rad == pytest.approx(
        scale * np.sqrt(share) / noise_model.LEVER_MM, rel=0.06
    )


@pytest.mark.parametrize("known", [False, True])
def test_lengths_that_nothing_absorbs_leave_the_noise_as_it_is(known: bool) -> None:
    """Their uncertainty is in mm, the rests' noise a hundredth of one: in units of that noise each
    length would have the weight of ten thousand rests."""
    n, scale = 600, 0.01
    problem = linear(9, n, 10)
    lengths = np.full(8, 0.003)
    problem.rests.observations.distances.standard_uncertainty_mm = lengths
    rng = np.random.default_rng(10)
    root = np.linalg.cholesky(noise_model._covariance(problem, 0.4))
    of_rests = scale * (root @ rng.normal(size=(n, 3, 1))).ravel()
    nothing = to_blocks([np.zeros((3 * n + 8, 0))], problem.rests.observations.placement)
    found = None
    for _ in range(2 if known else 1):
        residual = np.concatenate([of_rests, 2.0 * lengths * rng.choice([-1.0, 1.0], 8)])
        found = noise_model.estimate(problem, residual, nothing, np.zeros(0), found)
    assert found is not None
    assert found.scale_mm == pytest.approx(scale, rel=0.05)


def test_a_rest_far_off_counts_as_the_edge_in_its_own_direction() -> None:
    residual = np.zeros(9)
    residual[3:6] = [0.0, 6.0, 8.0]
    residual[6:] = [1.0, 1.0, 1.0]
    clipped = noise_model.clip_residual(residual, np.zeros(9), unit_noise(3), limit=5.0)
    np.testing.assert_allclose(clipped, [0, 0, 0, 0, 3, 4, 1, 1, 1])


@pytest.mark.parametrize("drift", [0.0, 1e-3, 3e-3, 1e-2, 0.1, 0.3, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_the_likeliest_scale_is_found_however_large_the_drift(drift: float, seed: int) -> None:
    """A search of 30 evaluations told 540 µm of noise for 3, beside a drift of 1 mm."""
    rng, rows, scale = np.random.default_rng(seed), 300, 0.003
    columns = np.linalg.qr(rng.normal(size=(rows, 24)))[0] * np.sqrt(rng.uniform(0.5, 30.0, 24))
    residual = columns @ rng.normal(0.0, 1.0, 24) * drift + rng.normal(0.0, scale, rows)
    known = make_restricted(columns, residual)
    unlikely, found, drifted, settled = noise_model._best_scale(known)
    assert settled
    assert found == pytest.approx(scale, rel=0.15)  # four standard errors
    if drift >= scale:
        assert drifted == pytest.approx(drift, rel=0.7)
    on_a_grid = min(
        known.negative_log_likelihood(s, d)
        for s in scale * np.exp(np.linspace(-0.3, 0.3, 13))
        for d in max(drift, 1e-4) * np.exp(np.linspace(-1.0, 1.0, 21))
    )
    assert unlikely < on_a_grid + 0.05


@pytest.mark.parametrize("drift", [0.0, 3e-3, 0.1, 1.0])
def test_where_a_search_begins_does_not_decide_where_it_ends(drift: float) -> None:
    """A drift of 3 mm was a minimum of its own, beside the scale that the fit before had found."""
    rng, rows, scale = np.random.default_rng(3), 300, 0.003
    columns = np.linalg.qr(rng.normal(size=(rows, 24)))[0] * np.sqrt(rng.uniform(0.5, 30.0, 24))
    residual = columns @ rng.normal(0.0, 1.0, 24) * drift + rng.normal(0.0, scale, rows)
    known = make_restricted(columns, residual)
    likeliest, *_ = noise_model._best_scale(known)
    for near_scale in (0.01, 0.1, 1.0, 10.0, 100.0):
        for near_drift in (1e-7, 1e-4, 3e-3, 0.1, 3.0):
            near = scale * near_scale, near_drift
            cost, _, _, settled = noise_model._best_scale(known, near)
            assert settled
            assert cost == pytest.approx(likeliest, abs=0.05), near


def make_restricted(columns: F64, residual: F64) -> Restricted:
    """Products of orthogonal *columns* (rows, d) of a drift and a *residual*, nothing absorbed."""
    return Restricted(
        (columns**2).sum(axis=0),
        (columns.T @ residual)[:, None],
        np.array([[residual @ residual]]),
        np.empty(0),
        0,
        len(residual),
    )


def test_a_likelihood_without_shared_columns_prints_nothing(
    capfd: pytest.CaptureFixture[str],
) -> None:
    """LAPACK complains on stderr of a system of no equations; what is left is −2 ln L by hand."""
    none = np.empty(0)
    known = Restricted(none, np.empty((0, 1)), np.array([[8.0]]), none, 0, 30.0)
    assert known.negative_log_likelihood(2.0, 0.1) == pytest.approx(60.0 * np.log(2.0) + 2.0)
    assert capfd.readouterr() == ("", "")

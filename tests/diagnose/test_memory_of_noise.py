"""Noise that lasts from rest to rest, against its whole covariance: sources in each posture times
exp(−Δt/τ)."""

import numpy as np
import pytest

from armd.compensation.diagnose.problem.whitening import RestNoise
from armd.compensation.diagnose.scoring.noise_correlation import (
    CorrelationEstimator,
    RestOrder,
    compute_variance_of_sums,
)

N = 400
PLACEMENT = np.repeat(np.arange(8), 50)
TIP = np.broadcast_to(np.eye(3), (N, 3, 3))  # noise of the tip itself, whatever the posture


def times(rng: np.random.Generator) -> np.ndarray:
    """Rests 30 s apart on average, a quarter of an hour between placements."""
    return np.cumsum(rng.uniform(20.0, 40.0, N)) + 900.0 * PLACEMENT


def encoders(rng: np.random.Generator) -> np.ndarray:
    """Sources of five encoders and the hand at random postures, of unit variance at the tip."""
    joints = rng.normal(size=(N, 3, 5)) * np.array([300.0, 300.0, 200.0, 80.0, 30.0])
    covariance = joints @ joints.transpose(0, 2, 1) * 1e-10 + 1e-6 * np.eye(3)
    whitener = np.linalg.inv(np.linalg.cholesky(covariance))
    return RestNoise(1.0, 0.5, 0.0, 1e-5, 1e-3, whitener, np.zeros(0)).sources(joints)


def dense(time_s: np.ndarray, tau_s: float) -> np.ndarray:
    same = PLACEMENT[:, None] == PLACEMENT[None, :]
    return same * np.exp(-np.abs(time_s[:, None] - time_s[None, :]) / tau_s)


def noise_of(sources: np.ndarray, time_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n, 3) of sources each of which remembers for 45 s."""
    drawn = np.linalg.cholesky(dense(time_s, 45.0)) @ rng.normal(size=(N, sources.shape[2]))
    return np.einsum("nis,ns->ni", sources, drawn)


@pytest.mark.parametrize("tau_s", [15.0, 60.0, 120.0])
@pytest.mark.parametrize("of_encoders", [False, True])
def test_a_sum_varies_as_the_whole_covariance_says(tau_s: float, of_encoders: bool) -> None:
    rng = np.random.default_rng(1)
    time_s = times(rng)
    sources = encoders(rng) if of_encoders else TIP
    mixed = rng.permutation(N)  # the order of the rows does not matter
    weights = np.empty((N, 3, 2))
    weights[:, :, 0] = (np.arange(N) > 180)[:, None] * [1.0, -2.0, 0.5]  # a step
    weights[:, :, 1] = rng.normal(size=(N, 3))
    kept = dense(time_s, tau_s)
    covariance = np.einsum("iax,jbx,ij->iajb", sources, sources, kept).reshape(3 * N, 3 * N)
    flat = weights.reshape(3 * N, 2)
    total = float(np.trace(flat.T @ covariance @ flat))
    sequence = RestOrder.from_rests(PLACEMENT[mixed], time_s[mixed])
    found = compute_variance_of_sums(weights[mixed], sources[mixed], tau_s, sequence)
    assert found == pytest.approx(total / (weights**2).sum(), rel=0.02)


@pytest.mark.parametrize("of_encoders", [False, True])
def test_the_time_constant_is_that_of_the_sources(of_encoders: bool) -> None:
    found = []
    for seed in range(40):
        rng = np.random.default_rng([2, seed])
        time_s = times(rng)
        sources = encoders(rng) if of_encoders else TIP
        noise = noise_of(sources, time_s, rng)
        found.append(
            CorrelationEstimator(sources, RestOrder.from_rests(PLACEMENT, time_s)).estimate(noise)
        )
    assert np.median([one.tau_s for one in found if one]) == pytest.approx(45.0, rel=0.1)
    assert {one.variance for one in found if one} == {1.0}


@pytest.mark.slow
def test_what_was_absorbed_hid_a_part_of_the_memory() -> None:
    """A base that may wander takes up what is slow: taken from independent noise nothing lasts, and
    of noise that does, τ and variance are those before it was taken. The variance is in units of
    that of independent noise of which as much is left."""
    taus, sizes, independent = [], [], []
    for seed in range(40):
        rng = np.random.default_rng([5, seed])
        time_s, sources = times(rng), encoders(rng)
        noise = noise_of(sources, time_s, rng)
        fresh = np.einsum("nis,ns->ni", sources, rng.normal(size=(N, sources.shape[2])))
        before = float((noise**2).sum() / (fresh**2).sum())
        absorbed = []
        for placement in range(8):
            rests = np.flatnonzero(placement == PLACEMENT)
            ramps = np.clip(np.arange(50)[:, None] / 10.0 - np.arange(6), 0.0, 1.0)
            columns = np.kron(ramps, np.eye(3))  # ridged: it takes a part of each
            values, vectors = np.linalg.eigh(columns.T @ columns + 4.0 * np.eye(18))
            own = columns @ (vectors / np.sqrt(values))
            absorbed.append((rests, own))
            for of in (noise, fresh):
                of[rests] -= (own @ (own.T @ of[rests].ravel())).reshape(-1, 3)
        estimator = CorrelationEstimator(sources, RestOrder.from_rests(PLACEMENT, time_s), absorbed)
        independent.append(estimator.estimate(fresh))
        memory = estimator.estimate(noise)
        assert memory is not None
        taus.append(memory.tau_s)
        sizes.append(memory.variance * float((noise**2).sum() / (fresh**2).sum()) / before)
    assert not any(independent)
    assert np.median(taus) == pytest.approx(45.0, rel=0.15)
    assert np.median(sizes) == pytest.approx(1.0, rel=0.05)


def test_certified_lengths_have_no_rests_and_say_nothing_of_a_memory() -> None:
    """Each may err by itself: columns that absorb, of rows that belong to no rest."""
    rng = np.random.default_rng(8)
    time_s, sources = times(rng), encoders(rng)
    noise, sequence = noise_of(sources, time_s, rng), RestOrder.from_rests(PLACEMENT, time_s)
    of_pose = (np.flatnonzero(PLACEMENT == 0), np.kron(np.ones((50, 1)), np.eye(3)) / 50**0.5)
    of_distances = (np.empty(0, dtype=np.int64), 0.5 * np.eye(15))
    without = CorrelationEstimator(sources, sequence, [of_pose]).estimate(noise)
    assert without is not None
    assert (
        CorrelationEstimator(sources, sequence, [of_pose, of_distances]).estimate(noise) == without
    )


def test_a_step_of_one_encoder_meets_all_of_its_memory() -> None:
    """Of an encoder's errors the tip shows less that lasts than the encoder's own angle does."""
    rng = np.random.default_rng(4)
    sources, time_s = encoders(rng), times(rng)
    sequence = RestOrder.from_rests(PLACEMENT, time_s)
    step = (sources[:, :, :1].transpose(0, 2, 1) * (np.arange(N) % 50 > 25)[:, None, None]).copy()
    weights = step.transpose(0, 2, 1)
    whole = compute_variance_of_sums(weights, sources, 45.0, sequence)
    assert whole > 1.3 * compute_variance_of_sums(weights, TIP, 45.0, sequence)


def test_independent_noise_has_no_memory_nor_have_readings_without_times() -> None:
    rng = np.random.default_rng(3)
    for i in range(300):
        noise = rng.standard_t(4, (N, 3))
        sources = encoders(rng) if i % 2 else TIP
        assert (
            CorrelationEstimator(sources, RestOrder.from_rests(PLACEMENT, times(rng))).estimate(
                noise
            )
            is None
        )
    untimed = RestOrder.from_rests(PLACEMENT, np.full(N, np.nan))
    assert CorrelationEstimator(TIP, untimed).estimate(np.ones((N, 3))) is None


def test_readings_left_out_say_nothing_of_a_memory() -> None:
    """Zeros in their place would make what is left look more alike than it is."""
    found = []
    for seed in range(40):
        rng = np.random.default_rng([6, seed])
        time_s, sources = times(rng), encoders(rng)
        noise = noise_of(sources, time_s, rng)
        noise[PLACEMENT < 4], sources[PLACEMENT < 4] = 0.0, 0.0
        found.append(
            CorrelationEstimator(sources, RestOrder.from_rests(PLACEMENT, time_s)).estimate(noise)
        )
    assert np.median([one.tau_s for one in found if one]) == pytest.approx(45.0, rel=0.1)


def test_where_all_is_absorbed_no_memory_shows() -> None:
    """Placements of two rests whose poses take up all but a rounding of what they leave."""
    rng = np.random.default_rng(7)
    placement = np.repeat(np.arange(200), 2)
    rounding = 1e-9 * np.repeat(rng.normal(size=(200, 3)), 2, axis=0)
    sequence = RestOrder.from_rests(placement, np.arange(400.0) * 20.0)
    absorbed = [(np.array([2 * k, 2 * k + 1]), np.eye(6)) for k in range(200)]
    assert CorrelationEstimator(TIP, sequence).estimate(rounding) is not None
    assert CorrelationEstimator(TIP, sequence, absorbed).estimate(rounding) is None

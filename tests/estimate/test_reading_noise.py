"""What a reading weighs: covariances written out, and the same of an arm of any size."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.estimate.noise.reading import ReadingNoise, Weighting, make_whitening

N, JOINTS = 6, 5
NOISE = ReadingNoise(encoder_rad=3e-6, reading_mm=2e-3)


def levers(seed: int = 1) -> np.ndarray:
    """d tip / d angle (n, 3, N), a few hundred mm."""
    return 300.0 * np.random.default_rng(seed).normal(size=(N, 3, JOINTS))


def written_out(joints: np.ndarray) -> np.ndarray:
    covariance = np.tile(NOISE.reading_mm**2 * np.eye(3), (N, 1, 1))
    for k in range(JOINTS):
        covariance += NOISE.encoder_rad**2 * np.einsum(
            "ni,nj->nij", joints[:, :, k], joints[:, :, k]
        )
    return covariance


def test_the_covariance_is_the_sum_over_encoders_and_the_tips_own() -> None:
    joints = levers()
    expected = written_out(joints)
    assert NOISE.covariance(joints) == pytest.approx(expected, rel=1e-12, abs=1e-18)
    per_axis = np.sqrt(np.mean([np.trace(one) / 3.0 for one in expected]))
    assert NOISE.compute_typical_mm(joints) == pytest.approx(per_axis)


def test_where_the_noise_was_found_it_weighs_as_it_was_found() -> None:
    joints, weight = levers(), np.full(N, 1.0)
    found = Weighting(NOISE, joints, weight).compute_whitening(joints)
    assert found == pytest.approx(make_whitening(written_out(joints), weight), rel=1e-9)


@pytest.mark.parametrize("size", [0.5, 0.9, 1.1, 2.0])
def test_an_arm_of_another_size_weighs_its_scatter_alike(size: float) -> None:
    """Scale is sacred: no sum of squares may fall because all lengths shrink."""
    joints, weight = levers(), np.full(N, 1.0)
    weighting = Weighting(NOISE, joints, weight)
    scatter = np.random.default_rng(2).normal(size=(N, 3, 1)) * 5e-3
    here = weighting.compute_whitening(joints) @ scatter
    there = weighting.compute_whitening(size * joints) @ (size * scatter)
    # But for the damping of `backwards`: a lever of 3 % of the longest is stretched by half.
    assert (there**2).sum() == pytest.approx((here**2).sum(), rel=0.02)
    fixed = np.linalg.inv(np.linalg.cholesky(written_out(joints)))
    assert ((fixed @ (size * scatter)) ** 2).sum() == pytest.approx(size**2 * (here**2).sum())

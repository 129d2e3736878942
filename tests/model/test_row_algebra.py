"""Small matrices of each row, against numpy's of all rows."""

import numpy as np
import pytest

from armd.compensation.model.row_algebra import compute_stretched_covariance, compute_whitening

RNG = np.random.default_rng(3)
N = 20


def test_whitening_makes_the_weight_of_a_covariance() -> None:
    root = RNG.normal(size=(N, 3, 4))
    covariance, weight = root @ root.transpose(0, 2, 1), RNG.uniform(0.0, 2.0, N)
    whiten = compute_whitening(covariance, weight)
    assert not np.triu(whiten, 1).any()
    wanted = weight[:, None, None] * np.linalg.inv(covariance)
    np.testing.assert_allclose(whiten.transpose(0, 2, 1) @ whiten, wanted, rtol=1e-9, atol=1e-12)


def test_a_covariance_that_is_none_is_refused() -> None:
    covariance = np.tile(np.eye(3), (2, 1, 1))
    covariance[1, 0, 1] = covariance[1, 1, 0] = 1.5
    with pytest.raises(np.linalg.LinAlgError):
        compute_whitening(covariance, np.ones(2))


def test_what_is_not_of_the_encoders_is_stretched_as_the_levers_are() -> None:
    before, levers = RNG.normal(size=(2, N, 3, 6))
    backwards, own = np.linalg.pinv(before), RNG.uniform(1.0, 2.0, N)
    stretch = np.eye(3) + (levers - before) @ backwards
    wanted = 0.25 * levers @ levers.transpose(0, 2, 1)
    wanted += own[:, None, None] * (stretch @ stretch.transpose(0, 2, 1))
    found = compute_stretched_covariance(levers, before, backwards, 0.25, own)
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)

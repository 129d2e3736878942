"""Rigid motions by groups, against scipy's for one set at a time."""

import numpy as np
from scipy.spatial.transform import Rotation

from armd.compensation.estimate.placements.rigid_motions import fit_by_kabsch


def test_each_group_moves_as_scipy_aligns_it_alone() -> None:
    rng = np.random.default_rng(1)
    n, groups = 90, 4
    group, weight = rng.integers(0, groups, n), rng.uniform(0.1, 2.0, n)
    points = 100.0 * rng.normal(size=(n, 3))
    turns, shifts = Rotation.random(groups, rng=2), 500.0 * rng.normal(size=(groups, 3))
    images = turns[group].apply(points) + shifts[group] + 0.5 * rng.normal(size=(n, 3))
    points[7] = np.nan  # a seat that nobody knows
    rotation, translation = fit_by_kabsch(points, images, weight, group, groups)
    for g in range(groups):
        own = np.flatnonzero((group == g) & np.isfinite(points[:, 0]))
        a, b = (np.average(x[own], axis=0, weights=weight[own]) for x in (points, images))
        alone, _ = Rotation.align_vectors(images[own] - b, points[own] - a, weight[own])
        np.testing.assert_allclose(rotation[g], alone.as_matrix(), atol=1e-10)
        np.testing.assert_allclose(translation[g], b - alone.apply(a), atol=1e-8)


def test_too_few_points_get_a_motion_that_fits_and_mirrors_none() -> None:
    points = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [5.0, 5.0, 5.0]])
    images = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, 2.0, 3.0]])
    group = np.array([0, 0, 1])
    rotation, translation = fit_by_kabsch(points, images, np.ones(3), group, 3)
    moved = np.einsum("nij,nj->ni", rotation[group], points) + translation[group]
    np.testing.assert_allclose(moved, images, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0)
    mirrored = points * [1.0, 1.0, -1.0] + [0.0, 0.0, 9.0]
    assert (
        np.linalg.det(fit_by_kabsch(points, mirrored, np.ones(3), np.zeros(3, int), 1)[0][0]) > 0.99
    )

"""Matrices that fall apart but for a border, against the same in full."""

import numpy as np
import pytest

from armd.compensation.estimate.linear.bordered import (
    BorderedParts,
    compute_inverse_root,
    compute_pseudo_inverse_root,
    compute_root_along_known,
)

BORDER = 4


def products(parts: int, each: int = 3, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Of columns of so many parts and a border, in no order; each one's part, −1: the border."""
    rng = np.random.default_rng(seed)
    of = np.append(np.repeat(np.arange(parts), each), np.full(BORDER, -1))
    found = np.zeros((len(of), len(of)))
    for part in range(parts):
        at = np.flatnonzero((of == part) | (of == -1))
        rows = rng.normal(size=(3 * len(at), len(at)))
        found[np.ix_(at, at)] += rows.T @ rows
    order = rng.permutation(len(of))
    return found[np.ix_(order, order)], of[order]


@pytest.mark.parametrize("parts", [5, 12])
def test_parts_are_what_meets_each_other_and_the_border_alone(parts: int) -> None:
    matrix, of = products(parts)
    found = BorderedParts.from_matrix(matrix)
    assert {tuple(part) for part in found.inner_parts} == {
        tuple(np.flatnonzero(of == part)) for part in range(parts)
    }
    np.testing.assert_array_equal(found.border, np.flatnonzero(of == -1))


@pytest.mark.parametrize("parts", [1, 2, 12])  # one and two hang together
def test_the_root_is_that_of_the_inverse(parts: int) -> None:
    matrix, _ = products(parts)
    inverse, side = np.linalg.inv(matrix), np.random.default_rng(2).normal(size=len(matrix))
    root, trace = compute_inverse_root(matrix)
    assert bool(root.inner_blocks) == (parts > 2)
    assert trace == pytest.approx(np.trace(inverse))
    np.testing.assert_allclose(root.to_dense() @ root.to_dense().T, inverse, atol=1e-12)
    np.testing.assert_allclose(root.multiply_square(side), inverse @ side, atol=1e-12)
    np.testing.assert_allclose(root.compute_square(slice(1, 6)), inverse[1:6, 1:6], atol=1e-12)
    columns = np.random.default_rng(4).normal(size=(len(matrix), 2))
    turned = root.multiply_transposed(columns)
    np.testing.assert_allclose(turned.T @ turned, columns.T @ inverse @ columns, atol=1e-12)
    by = np.arange(1.0, len(matrix) + 1.0)
    scaled = root.scaled(by).compute_square(slice(None))
    np.testing.assert_allclose(scaled, inverse * np.outer(by, by), atol=1e-10)


@pytest.mark.parametrize("parts", [1, 12])
def test_what_is_held_is_on_the_diagonal(parts: int) -> None:
    matrix, _ = products(parts)
    held = np.arange(1.0, len(matrix) + 1.0)
    expected = np.linalg.inv(matrix + np.diag(held))
    for root in (
        compute_inverse_root(matrix, held)[0],
        compute_pseudo_inverse_root(matrix, added_diagonal=held),
    ):
        np.testing.assert_allclose(root.compute_square(slice(None)), expected, atol=1e-12)
    nothing = compute_pseudo_inverse_root(
        np.zeros_like(matrix), added_diagonal=np.where(held > 2.0, held, 0.0)
    )
    told = np.where(held > 2.0, 1.0 / held, 0.0)
    np.testing.assert_allclose(nothing.compute_square(slice(None)), np.diag(told), atol=1e-12)


@pytest.mark.parametrize("unknown", ["of a part", "of the border"])
def test_what_nothing_tells_stays_where_it_is(unknown: str) -> None:
    matrix, of = products(12)
    at = np.flatnonzero((of == 3) if unknown == "of a part" else (of == -1))[0]
    matrix[at] = matrix[:, at] = 0.0
    found = compute_pseudo_inverse_root(matrix).compute_square(slice(None))
    np.testing.assert_allclose(found, np.linalg.pinv(matrix, hermitian=True), atol=1e-10)


def test_a_root_has_the_directions_that_are_known_and_no_other() -> None:
    vectors = np.linalg.qr(np.random.default_rng(3).normal(size=(4, 4)))[0]
    values = np.array([2.0, 1.0, 1e-7, 0.0])
    matrix = vectors * values @ vectors.T
    for least, beside, kept in ((1e-9, 1e-300, 3), (1e-6, 1e-300, 2), (1e-9, 1e3, 2)):
        root = compute_root_along_known(matrix, least, beside)
        expected = vectors[:, :kept] / values[:kept] @ vectors[:, :kept].T
        assert root.shape == (4, kept)
        np.testing.assert_allclose(root @ root.T, expected, rtol=1e-6, atol=1e-6)

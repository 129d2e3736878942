"""Symmetric matrices of independent parts and a border: a part meets the border and itself only.

A placement's pose, and the drift of a base during the placement, meet what all placements share,
but nothing of another placement. Working part by part on their products takes a time in proportion
to the number of parts; on all columns at once, in proportion to its cube.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dtrtrs
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from armd.arrays import F64, I64, Mask

#: Least eigenvalue of a known direction relative to the largest, unknowns scaled by the diagonal.
LEAST_KNOWN = 1e-13
#: So few columns are solved together faster than it takes to find their independent parts.
FEW = 32
#: A column that meets more than this share of all others belongs to the border.
MOST_MET = 0.5


@dataclass(frozen=True)
class BorderedParts:
    """The columns of a symmetric matrix (b, b) by part, and the border: all others."""

    inner_parts: tuple[I64, ...]
    border: I64

    @classmethod
    def from_matrix(cls, matrix: F64 | Mask) -> BorderedParts:
        """Find the parts by the nonzero elements; all columns may form one part."""
        meets = matrix != 0.0
        np.fill_diagonal(meets, True)
        inner = np.arange(len(matrix))
        while not (few := meets.sum(axis=0) <= MOST_MET * len(inner)).all():
            inner, meets = inner[few], meets[np.ix_(few, few)]
        row, column = np.nonzero(meets)
        links = coo_array((np.ones(len(row)), (row, column)), shape=(len(inner),) * 2)
        _, label = connected_components(links, directed=False)
        order = np.argsort(label, kind="stable")
        parts = np.split(inner[order], np.flatnonzero(np.diff(label[order])) + 1)
        return cls(
            tuple(part for part in parts if len(part)), np.setdiff1d(np.arange(len(matrix)), inner)
        )


@dataclass(frozen=True)
class Root:
    """A factor F (b, r), stored as blocks of columns for parts of the rows, and border columns.

    The columns of each block are nonzero only in the rows of its part; the border's are nonzero in
    all rows.
    """

    inner_blocks: tuple[tuple[I64, F64], ...]
    border: F64  # (b, ·) columns

    def scaled(self, by: F64) -> Root:
        """Return the root with every row multiplied by its factor (b,)."""
        blocks = tuple((rows, by[rows, None] * values) for rows, values in self.inner_blocks)
        return Root(blocks, by[:, None] * self.border)

    def to_dense(self) -> F64:
        """Return the matrix (b, r) in full."""
        blocks = []
        for rows, values in self.inner_blocks:
            block = np.zeros((len(self.border), values.shape[1]))
            block[rows] = values
            blocks.append(block)
        return np.hstack([*blocks, self.border])

    def multiply_transposed(self, across: F64) -> F64:
        """Return Fᵀ times columns (b, …)."""
        products = (values.T @ across[rows] for rows, values in self.inner_blocks)
        return np.concatenate([*products, self.border.T @ across])

    def multiply_square(self, side: F64) -> F64:
        """Return F Fᵀ times a vector (b,)."""
        product: F64 = self.border @ (self.border.T @ side)
        for rows, values in self.inner_blocks:
            product[rows] += values @ (values.T @ side[rows])
        return product

    def compute_square(self, rows: slice) -> F64:
        """Return F Fᵀ of some rows (m, m)."""
        border = self.border[rows]
        product: F64 = border @ border.T
        turn = np.full(len(self.border), -1)
        turn[rows] = np.arange(len(product))
        for numbers, values in self.inner_blocks:
            is_chosen = turn[numbers] >= 0
            chosen = values[is_chosen]
            product[np.ix_(turn[numbers[is_chosen]], turn[numbers[is_chosen]])] += chosen @ chosen.T
        return product


def compute_inverse_root(matrix: F64, added_diagonal: F64 | float = 0.0) -> tuple[Root, float]:
    """Return F with F Fᵀ the inverse of a positive definite *matrix*, and its trace.

    The trace is the inverse's. *matrix* is (b, b), and *added_diagonal* (b,) is added to its
    diagonal. Raises `numpy.linalg.LinAlgError` where it is not positive definite.
    """
    added_diagonal = np.broadcast_to(added_diagonal, (len(matrix),))
    root, trace, _ = _compute_inverse_root(matrix, added_diagonal, np.ones(len(matrix)))
    return root, trace


def compute_pseudo_inverse_root(matrix: F64, added_diagonal: F64 | float = 0.0) -> Root:
    """Return F (b, r) with F Fᵀ the pseudo-inverse: unknown directions of a solution stay 0.

    Whether a direction is known is decided with each unknown in units of its own diagonal
    (`LEAST_KNOWN`). Otherwise a prior on one unknown that is far tighter than the rows would make
    the others look unknown. *added_diagonal* (b,) is added to the diagonal without a copy of a
    large matrix.
    """
    added_diagonal = np.broadcast_to(added_diagonal, (len(matrix),))
    size = np.sqrt(np.maximum(np.diag(matrix) + added_diagonal, 0.0))
    size[size == 0.0] = 1.0
    if (known_root := _compute_root_of_known(matrix, added_diagonal, size)) is not None:
        return known_root.scaled(1.0 / size)
    unit = matrix / np.outer(size, size)
    unit[np.diag_indices_from(unit)] += added_diagonal / size**2
    return Root((), compute_root_along_known(unit, LEAST_KNOWN) / size[:, None])


def compute_root_along_known(matrix: F64, least_share: float, least_scale: float = 1e-300) -> F64:
    """Return F (b, r) with F Fᵀ the inverse along the known eigenvectors.

    An eigenvalue is known if it exceeds *least_share* times the largest one, which counts as at
    least *least_scale*.
    """
    values, vectors = np.linalg.eigh(matrix)
    is_known = values > least_share * max(float(values.max(initial=0.0)), least_scale)
    root: F64 = vectors[:, is_known] / np.sqrt(values[is_known])
    return root


def compute_pseudo_inverse_factor(matrix: F64) -> F64:
    """Return the factor of `compute_pseudo_inverse_root` as a dense matrix."""
    return compute_pseudo_inverse_root(matrix).to_dense()


def _compute_root_of_known(matrix: F64, added_diagonal: F64, size: F64) -> Root | None:
    """Return the root in units of *size* (b,) if certainly everything is known, else None.

    This test needs no eigenvalues: none is below one over the inverse's trace, none above the
    largest sum of a row.
    """
    try:
        root, trace, largest = _compute_inverse_root(matrix, added_diagonal, size)
    except np.linalg.LinAlgError:
        return None
    return root if trace * largest * LEAST_KNOWN < 1.0 else None


def _compute_inverse_root(matrix: F64, added_diagonal: F64, size: F64) -> tuple[Root, float, float]:
    """Return root and trace as `compute_inverse_root`, and the largest sum of a row.

    The matrix, with *added_diagonal* (b,) on its diagonal, is taken in units of *size* (b,).
    """

    def block(rows: I64, columns: I64) -> F64:
        part: F64 = matrix[np.ix_(rows, columns)] / np.outer(size[rows], size[columns])
        if rows is columns:
            part[np.diag_indices_from(part)] += added_diagonal[rows] / size[rows] ** 2
        return part

    together = BorderedParts((), np.arange(len(matrix)))
    parts = together if len(matrix) <= FEW else BorderedParts.from_matrix(matrix)
    border_columns = parts.border
    border_matrix = block(border_columns, border_columns)
    of_rest, largest = np.abs(border_matrix).sum(axis=1), 0.0
    inverses, crossings = [], []
    for inner in parts.inner_parts:
        within, meeting = block(inner, inner), block(inner, border_columns)
        of_rest += np.abs(meeting).sum(axis=0)
        sums = np.abs(within).sum(axis=1) + np.abs(meeting).sum(axis=1)
        largest = max(largest, float(sums.max()))
        inverse = _compute_inverse_factor(within)
        across = inverse.T @ meeting
        border_matrix -= across.T @ across
        inverses.append((inner, inverse))
        crossings.append(across)
    last = _compute_inverse_factor(border_matrix)
    border = np.zeros((len(matrix), len(border_columns)))
    border[border_columns] = last
    for (inner, inverse), across in zip(inverses, crossings, strict=True):
        border[inner] = -inverse @ (across @ last)
    trace = float((border**2).sum() + sum((values**2).sum() for _, values in inverses))
    return Root(tuple(inverses), border), trace, max(largest, float(of_rest.max(initial=0.0)))


def _compute_inverse_factor(matrix: F64) -> F64:
    """Return the upper triangular F with F Fᵀ the inverse."""
    return invert_lower(np.asarray(np.linalg.cholesky(matrix), dtype=np.float64))


def invert_lower(lower: F64) -> F64:
    """Return the upper F with F Fᵀ the inverse of a matrix, from its Cholesky factor *lower*."""
    if not len(lower):
        return lower
    # LAPACK itself: scipy's own function checks its arguments for longer than this takes.
    inverse, fault = dtrtrs(lower.T, np.eye(len(lower)), lower=False, trans=1)
    if fault:
        raise np.linalg.LinAlgError("a factor of Cholesky with a zero on its diagonal")
    return np.asarray(inverse.T, dtype=np.float64)

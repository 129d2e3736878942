"""One linear least-squares problem: named blocks of columns, every amplitude with a prior.

    residual = Σ columns · amplitudes + noise of unit variance

It is stored as sums of products over whitened rows: many questions need one pass over the rows, and
problems of different rows are added. Each question has one method here, with one rule for
directions that the rows do not determine:

- `project`: the part of other columns that the blocks do not take. An unknown direction (a gauge)
  takes nothing: it has a tiny weight, so that rounding is not mistaken for information.
- `solve`: the amplitudes, and their covariance. Along directions that the rows do not determine,
  each has the variance `nominal_variance`; where none is stated, it stays 0 (pseudo-inverse).
- `solve_with_prior`: the solution with the nominal prior along *directions* that the rows hardly
  determine, and along no other: well-known directions do not move for it.
- `compute_information`: the information of rows and priors on some blocks, all others being
  fitted along.
- `without`: the problem without a block.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve

from armd.arrays import F64, I64
from armd.compensation.estimate.linear.bordered import (
    Root,
    compute_inverse_root,
    compute_pseudo_inverse_root,
    invert_lower,
)
from armd.compensation.estimate.linear.solution import Solution, solve_with_prior

#: Weight that stands for none, beside columns of unit length: far above rounding (1e-16), far
#: below the least share that decides anything (1e-6 of a candidate that survives projection).
HELD = 1e-12
#: A direction of a block this short (squared), beside the block's longest column, takes nothing
#: of others: the remainder of a seat's motion that its placement explains is rounding.
LEAST_TAKEN = 1e-10
#: With more columns, a projection is computed by parts: 3,000 columns in 100 placements, all at
#: once, take two seconds and six times the memory of their products.
MANY = 500


@dataclass(frozen=True)
class Layout:
    """The columns of each block, in their order."""

    sizes: tuple[tuple[str, int], ...]  # names are unique

    @cached_property
    def _slices(self) -> dict[str, slice]:
        edges = np.cumsum([0, *(size for _, size in self.sizes)]).tolist()
        names = (name for name, _ in self.sizes)
        return {
            name: slice(low, high)
            for name, (low, high) in zip(names, itertools.pairwise(edges), strict=True)
        }

    @property
    def n(self) -> int:
        """The number of columns."""
        return sum(size for _, size in self.sizes)

    def __getitem__(self, name: str) -> slice:
        return self._slices[name]

    def find_columns(self, names: Iterable[str]) -> I64:
        """Return the numbers of the columns of some blocks, block after block."""
        numbers = np.arange(self.n)
        return np.concatenate([np.empty(0, dtype=np.int64), *(numbers[self[n]] for n in names)])

    def find_other_columns(self, names: Iterable[str]) -> I64:
        """Return the numbers of the columns of all other blocks."""
        left_out = frozenset(names)
        return self.find_columns(name for name, _ in self.sizes if name not in left_out)

    def only(self, columns: I64) -> Layout:
        """Return the layout of some columns, ascending; blocks without any of them stay, empty."""
        owner = np.repeat(np.arange(len(self.sizes)), [size for _, size in self.sizes])
        counts = np.bincount(owner[columns], minlength=len(self.sizes))
        names = (name for name, _ in self.sizes)
        return Layout(tuple(zip(names, counts.tolist(), strict=True)))


@dataclass(frozen=True)
class LinearModel:
    """Sums of products over whitened rows of b columns, in blocks; amplitudes normal about zero."""

    layout: Layout
    gram: F64  # (b, b) products of the columns
    variance: F64  # (b,) of the amplitudes a priori; inf: free
    squared_norm: F64  # (b,) squared lengths of the columns before anything was projected out
    nominal_variance: (
        F64  # (b,) variance of the nominal prior where rows leave a direction open; inf: none
    )

    @classmethod
    def from_products(
        cls,
        layout: Layout,
        gram: F64,
        variance: F64,
        *,
        nominal_variance: F64 | None = None,
        squared_norm: F64 | None = None,
    ) -> LinearModel:
        """Make the problem from the columns' products (b, b).

        *squared_norm* (b,): the columns' squared lengths before others were eliminated.
        """
        nominal_variance = (
            np.full(len(gram), np.inf) if nominal_variance is None else nominal_variance
        )
        return cls(
            layout,
            gram,
            variance,
            np.diag(gram) if squared_norm is None else squared_norm,
            nominal_variance,
        )

    @classmethod
    def from_rows(cls, blocks: Sequence[tuple[str, F64, F64]]) -> LinearModel:
        """Make the problem of blocks: name, whitened columns (N, m), variances (m,)."""
        layout = Layout(tuple((name, columns.shape[1]) for name, columns, _ in blocks))
        rows = np.hstack([columns for _, columns, _ in blocks])
        return cls.from_products(layout, rows.T @ rows, np.concatenate([v for *_, v in blocks]))

    def only(self, columns: I64) -> LinearModel:
        """Return the problem of some columns, by number, ascending."""
        if len(columns) == self.layout.n:
            return self
        return LinearModel(
            self.layout.only(columns),
            self.gram[np.ix_(columns, columns)],
            self.variance[columns],
            self.squared_norm[columns],
            self.nominal_variance[columns],
        )

    def without(self, *names: str) -> LinearModel:
        """Return the problem without some blocks."""
        return self.only(self.layout.find_other_columns(names))

    def with_variance(self, variance: F64) -> LinearModel:
        """Return the problem of these rows with other priors (b,)."""
        return replace(self, variance=variance)

    def add_rows(self, rows: F64) -> LinearModel:
        """Return the problem with more whitened rows (…, b)."""
        flat = rows.reshape(-1, rows.shape[-1])
        added = flat.T @ flat
        return replace(
            self, gram=self.gram + added, squared_norm=self.squared_norm + np.diag(added)
        )

    def without_rows(self) -> LinearModel:
        """Return the problem with the unknowns' priors and no rows."""
        return replace(
            self, gram=np.zeros_like(self.gram), squared_norm=np.zeros_like(self.squared_norm)
        )

    def add_block(
        self, name: str, products: F64, across: F64, variance: F64, squared_norm: F64 | None = None
    ) -> LinearModel:
        """Return the problem with one block more.

        *products* (m, m) are those of its columns, *across* (b, m) those with the existing columns,
        *variance* (m,) of its amplitudes; *squared_norm* (m,) as in `from_products`.
        """
        return LinearModel(
            Layout((*self.layout.sizes, (name, len(products)))),
            np.block([[self.gram, across], [across.T, products]]),
            np.concatenate([self.variance, variance]),
            np.concatenate(
                [self.squared_norm, np.diag(products) if squared_norm is None else squared_norm]
            ),
            np.concatenate([self.nominal_variance, np.full(len(products), np.inf)]),
        )

    def __add__(self, model: LinearModel) -> LinearModel:
        """Return the problem of the rows of both."""
        return replace(
            self, gram=self.gram + model.gram, squared_norm=self.squared_norm + model.squared_norm
        )

    @cached_property
    def length(self) -> F64:
        """The lengths (b,) of the columns; 1 for one that is zero."""
        return np.where(self.squared_norm > 0.0, np.sqrt(self.squared_norm), 1.0)

    @cached_property
    def factor(self) -> F64:
        """The factor F (b, b) of projections: columns · F are an orthonormal basis."""
        return invert_lower(self._lower) / self.length[:, None]

    @cached_property
    def _lower(self) -> F64:
        """The Cholesky factor of the products of columns of unit length.

        Unknown directions (gauges) get a weight so small that they project as they should.
        """
        softly_fixed = self._unit() + HELD * np.eye(self.layout.n)
        return np.asarray(np.linalg.cholesky(softly_fixed), dtype=np.float64)

    def project(self, across: F64) -> F64:
        """Return coordinates (b, …) of the part of other columns that the blocks take.

        The basis is that of `factor`. *across* (b, …) are products with these columns. Products of
        the remaining parts are the columns' products less the coordinates' products.
        """
        if self.layout.n > MANY:
            return self._projecting_root.multiply_transposed(across)
        coordinates: F64 = self.factor.T @ across
        return coordinates

    @cached_property
    def _projecting_root(self) -> Root:
        """The `factor` of many columns."""
        diagonal = 1.0 / self.variance + HELD * self.length**2
        return compute_inverse_root(self.gram, diagonal)[0]

    def explain(self, across: F64) -> F64:
        """Return amplitudes (b, …) that explain other columns best, by products with them."""
        scaled = (across.T / self.length).T
        solved = cho_solve((self._lower, True), scaled, check_finite=False)
        amplitudes: F64 = (solved.T / self.length).T
        return amplitudes

    def solve(self, side: F64) -> tuple[F64, F64]:
        """Return amplitudes (b,) from products (b,) with a residual, and covariance (b, b).

        A direction that neither rows nor a prior determine stays 0.
        """
        return self.solve_amplitudes(side), self.covariance

    def solve_amplitudes(self, side: F64) -> F64:
        """Return the amplitudes (b,) of `solve`; the covariance would take three times as long."""
        return self._root.multiply_square(side)

    @cached_property
    def covariance(self) -> F64:
        """The covariance (b, b) of the amplitudes of `solve`."""
        return self.covariance_of(slice(None))

    def covariance_of(self, columns: slice) -> F64:
        """Return the covariance (m, m) of some amplitudes of `solve`."""
        return self._root.compute_square(columns)

    @cached_property
    def _root(self) -> Root:
        """The root (b, r) whose product with its transpose is the covariance."""
        prior_weight = 1.0 / np.minimum(self.variance, self.nominal_variance)
        return compute_pseudo_inverse_root(self.gram, added_diagonal=prior_weight)

    def solve_with_prior(
        self, side: F64, nominal: F64, damping: float = 0.0, along_all: bool = False
    ) -> Solution:
        """Solve with the nominal prior along directions known worse than a tenth of a departure.

        *side* (b,): products with a residual. The nominal values, at which the amplitudes are
        *nominal* (b,), count along these directions as one more row, with an uncertainty of one
        departure (docs/decisions/0023); *along_all*: along all directions. A departure is the root
        of `nominal_variance`, which has to be finite. *damping* is relative to the best known
        direction.
        """
        return solve_with_prior(
            self.gram, side, np.sqrt(self.nominal_variance), nominal, damping, along_all
        )

    def compute_information(self, *names: str) -> F64:
        """Return the information (m, m) on some blocks, in the order of *names*.

        Their own priors are included; all other amplitudes are fitted along.
        """
        columns = self.layout.find_columns(names)
        remaining = self.layout.find_other_columns(names)
        projected = self.only(remaining).project(self.gram[np.ix_(remaining, columns)])
        reduced_gram: F64 = self.gram[np.ix_(columns, columns)] - projected.T @ projected
        return (reduced_gram + reduced_gram.T) / 2.0 + np.diag(1.0 / self.variance[columns])

    def _unit(self) -> F64:
        """Return products (b, b) of columns of unit length, with their priors on the diagonal."""
        scaled: F64 = self.gram / self.length
        scaled /= self.length[:, None]
        scaled[np.diag_indices_from(scaled)] += 1.0 / (self.variance * self.length**2)
        return scaled


def factorise_known(matrix: F64, lower: F64 | None) -> F64:
    """Return F (m, r) with F Fᵀ the inverse of *matrix* (m, m) along its known eigenvectors.

    The columns are in one unit. *lower*: the matrix's Cholesky factor, if it has one. If certainly
    all directions are known, no eigenvalues are computed: none is below one over the inverse's
    trace.
    """
    if lower is not None:
        factor = invert_lower(lower)
        if float((factor**2).sum()) * LEAST_TAKEN < 1.0:
            return factor
    values, vectors = np.linalg.eigh(matrix)
    is_known = values > LEAST_TAKEN
    along: F64 = vectors[:, is_known] / np.sqrt(values[is_known])
    return along


def factorise_lower(matrices: F64) -> Sequence[F64 | None]:
    """Return the lower Cholesky factor of each of *matrices* (s, m, m); None if it has none."""
    try:
        return list(np.linalg.cholesky(matrices))
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return [None]
    return [factor for matrix in matrices for factor in factorise_lower(matrix[None])]

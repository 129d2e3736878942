"""One linear least-squares problem: named blocks of columns, every amplitude with a prior.

    residual = Σ columns · amplitudes + noise of unit variance

It is kept as sums of products over whitened rows: asked many times, it passes over the rows once,
and problems of different rows are added. Each question has one answer here, with one rule for what
the rows do not hold:

- `project`: what the blocks leave of other columns. A direction of which nothing is known (a
  gauge) takes nothing: it is held softly, so that rounding is not mistaken for knowledge.
- `solve`: the amplitudes, and their covariance. Along what the rows do not hold, each stays at
  its `nominal_variance`, good to a stated departure; where none is stated, it stays 0
  (pseudo-inverse).
- `solve_with_prior`: the same where the drawing has a say along *directions* that the rows hardly
  tell, and in no other: what is known does not move for it.
- `compute_information`: what rows and priors tell of some blocks, all others being fitted along.
- `without`: the same problem without a block.
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

#: Weight of nothing, beside columns of unit length: far above rounding (1e-16), far below what
#: decides anything (a candidate's share of 1e-6 that survives projection).
HELD = 1e-12
#: A direction of a block this short (squared), beside the block's longest column, says nothing of
#: others: what of a seat's motion its placement explains is rounding, not information.
LEAST_TAKEN = 1e-10
#: More columns than that are worth being taken apart for a projection: of 3,000 in 100 placements
#: all at once take two seconds and six times the memory of their products.
MANY = 500


@dataclass(frozen=True)
class Layout:
    """Which columns belong to which block, in their order."""

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
        """How many columns there are."""
        return sum(size for _, size in self.sizes)

    def __getitem__(self, name: str) -> slice:
        return self._slices[name]

    def find_columns(self, names: Iterable[str]) -> I64:
        """Numbers of the columns of some blocks, block after block."""
        numbers = np.arange(self.n)
        return np.concatenate([np.empty(0, dtype=np.int64), *(numbers[self[n]] for n in names)])

    def find_other_columns(self, names: Iterable[str]) -> I64:
        """Numbers of the columns of all other blocks."""
        left_out = frozenset(names)
        return self.find_columns(name for name, _ in self.sizes if name not in left_out)

    def only(self, columns: I64) -> Layout:
        """The layout of some columns, ascending; blocks of which none is left stay, empty."""
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
        F64  # (b,) variance with which to choose where the rows leave it open; inf: none
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
        """By the columns' products (b, b); *squared_norm* (b,) where something was projected out of
        them before."""
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
        """Of blocks: a name, whitened columns (N, m) and the variances (m,) of their amplitudes."""
        layout = Layout(tuple((name, columns.shape[1]) for name, columns, _ in blocks))
        rows = np.hstack([columns for _, columns, _ in blocks])
        return cls.from_products(layout, rows.T @ rows, np.concatenate([v for *_, v in blocks]))

    def only(self, columns: I64) -> LinearModel:
        """The problem of some columns, by number, ascending."""
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
        """The problem without some blocks."""
        return self.only(self.layout.find_other_columns(names))

    def with_variance(self, variance: F64) -> LinearModel:
        """The same rows under other priors (b,)."""
        return replace(self, variance=variance)

    def measured(self, rows: F64) -> LinearModel:
        """With more whitened rows (…, b)."""
        flat = rows.reshape(-1, rows.shape[-1])
        added = flat.T @ flat
        return replace(
            self, gram=self.gram + added, squared_norm=self.squared_norm + np.diag(added)
        )

    def without_rows(self) -> LinearModel:
        """The same unknowns with their priors, and nothing measured."""
        return replace(
            self, gram=np.zeros_like(self.gram), squared_norm=np.zeros_like(self.squared_norm)
        )

    def joined(
        self, name: str, products: F64, across: F64, variance: F64, squared_norm: F64 | None = None
    ) -> LinearModel:
        """With one block more: products of its columns (m, m), with those there (b, m), and the
        variances (m,) of its amplitudes; *squared_norm* (m,) as in `from_products`."""
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
        """The problem of both's rows."""
        return replace(
            self, gram=self.gram + model.gram, squared_norm=self.squared_norm + model.squared_norm
        )

    @cached_property
    def length(self) -> F64:
        """(b,) lengths of the columns; 1 for one that is zero."""
        return np.where(self.squared_norm > 0.0, np.sqrt(self.squared_norm), 1.0)

    @cached_property
    def factor(self) -> F64:
        """F (b, b), F Fᵀ what projects: columns · F are an orthonormal basis of what they take."""
        return invert_lower(self._lower) / self.length[:, None]

    @cached_property
    def _lower(self) -> F64:
        """Cholesky's factor of the products of columns of unit length. Directions of which nothing
        is known (gauges) are held so softly that they clear as they should."""
        softly_fixed = self._unit() + HELD * np.eye(self.layout.n)
        return np.asarray(np.linalg.cholesky(softly_fixed), dtype=np.float64)

    def project(self, across: F64) -> F64:
        """Coordinates (b, …) along that basis of what the blocks take of other columns, from their
        products (b, …) with these: products of what is left are those less these coordinates'."""
        if self.layout.n > MANY:
            return self._projecting_root.multiply_transposed(across)
        coordinates: F64 = self.factor.T @ across
        return coordinates

    @cached_property
    def _projecting_root(self) -> Root:
        """`factor` of many columns."""
        diagonal = 1.0 / self.variance + HELD * self.length**2
        return compute_inverse_root(self.gram, diagonal)[0]

    def explain(self, across: F64) -> F64:
        """Amplitudes (b, …) that explain other columns best, from their products (b, …)."""
        scaled = (across.T / self.length).T
        solved = cho_solve((self._lower, True), scaled, check_finite=False)
        amplitudes: F64 = (solved.T / self.length).T
        return amplitudes

    def solve(self, side: F64) -> tuple[F64, F64]:
        """Amplitudes (b,) from the products (b,) with a residual, and their covariance (b, b).

        What neither rows, prior nor drawing say anything of stays 0.
        """
        return self.solve_amplitudes(side), self.covariance

    def solve_amplitudes(self, side: F64) -> F64:
        """What `solve` finds (b,), without its covariance, which takes three times as long."""
        return self._root.multiply_square(side)

    @cached_property
    def covariance(self) -> F64:
        """(b, b) of the amplitudes that `solve` finds."""
        return self.covariance_of(slice(None))

    def covariance_of(self, columns: slice) -> F64:
        """The same of some columns (m, m)."""
        return self._root.compute_square(columns)

    @cached_property
    def _root(self) -> Root:
        """(b, r), times its transpose the covariance."""
        prior_weight = 1.0 / np.minimum(self.variance, self.nominal_variance)
        return compute_pseudo_inverse_root(self.gram, added_diagonal=prior_weight)

    def solve_with_prior(
        self, side: F64, drawn: F64, damping: float = 0.0, along_all: bool = False
    ) -> Solution:
        """Amplitudes from the products (b,) with a residual, and what is known of them.

        Along directions known worse than a tenth of a departure (docs/decisions/0023) the drawing,
        where the amplitudes are *drawn* (b,), counts as one more row, good to one; *along_all*:
        along all. A departure is the root of `nominal_variance`, which has to be finite. *damping*
        is relative to the best known direction.
        """
        return solve_with_prior(
            self.gram, side, np.sqrt(self.nominal_variance), drawn, damping, along_all
        )

    def compute_information(self, *names: str) -> F64:
        """(m, m) of some blocks, in the order of *names*, their own priors included, all other
        amplitudes being fitted along."""
        columns = self.layout.find_columns(names)
        remaining = self.layout.find_other_columns(names)
        projected = self.only(remaining).project(self.gram[np.ix_(remaining, columns)])
        reduced_gram: F64 = self.gram[np.ix_(columns, columns)] - projected.T @ projected
        return (reduced_gram + reduced_gram.T) / 2.0 + np.diag(1.0 / self.variance[columns])

    def _unit(self) -> F64:
        """(b, b) products of columns of unit length, their priors on the diagonal."""
        scaled: F64 = self.gram / self.length
        scaled /= self.length[:, None]
        scaled[np.diag_indices_from(scaled)] += 1.0 / (self.variance * self.length**2)
        return scaled


def factorise_known(matrix: F64, lower: F64 | None) -> F64:
    """Return F (m, r) with F Fᵀ the inverse of *matrix* (m, m), of columns in one unit, along the
    eigenvectors of which something is known; *lower*: Cholesky's factor of it, if it has one.

    Where that is all of them for sure no eigenvalues are needed: none is below one over the
    inverse's trace.
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
    """Return Cholesky's lower factor of each of *matrices* (s, m, m); None where there is none."""
    try:
        return list(np.linalg.cholesky(matrices))
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return [None]
    return [factor for matrix in matrices for factor in factorise_lower(matrix[None])]

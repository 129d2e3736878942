"""The rows of one fit, whitened and clear of what absorbs in one placement only.

A placement's pose, and the base's drift during it, absorb only in its own rows: they are eliminated
there once. The columns that all placements share, about a hundred, stay. Products with thousands of
candidates' columns are then sums over placements: to hold a placement out, its term is omitted.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.data.in_order import run_in_order
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.signatures import Signatures
from armd.compensation.diagnose.scoring.cells import (
    ArtefactColumns,
    Cell,
    as_slice,
    clear_columns,
    compute_products_of_parts,
    list_rows,
    split_by_part,
    to_rows,
)
from armd.compensation.diagnose.scoring.evidence import Sums
from armd.compensation.diagnose.scoring.noise_correlation import CorrelationEstimator
from armd.compensation.diagnose.scoring.shape import Shapes, make_shapes
from armd.compensation.estimate.linear.blocks import Piece
from armd.compensation.estimate.linear.linear_model import Layout, LinearModel
from armd.compensation.model.arm import Arm

#: By the number m of a candidate's columns: candidates (c,), products within (parts, c, m, m).
Grams = dict[int, tuple[I64, F64]]


@dataclass(frozen=True, kw_only=True)
class Projection:
    """One fit's whitened rows, on which candidates are scored; b nuisance columns are shared."""

    fit: Fit
    arm: Arm
    shapes: Shapes
    cells: tuple[Cell, ...]
    jacobian: F64  # (P, N) whitened
    shared_number: I64  # (nuisance and shapes,) number among the shared columns; −1: eliminated
    parts: tuple[LinearModel, ...]  # the shared columns' problem, on each part's rows
    cleared: F64  # (N, b + 1) shared columns, then the residual, clear of the cells' own columns
    side: F64  # (parts, b) products of the shared columns with the residual, clear

    @cached_property
    def shared(self) -> LinearModel:
        """The shared columns' problem, on all rows."""
        return reduce(operator.add, self.parts)

    @cached_property
    def within(self) -> F64:
        """The products (b, b) of the shared columns among each other, clear of the cells' own
        columns.
        """
        return self.cleared[:, :-1].T @ self.cleared[:, :-1]

    @cached_property
    def correlation_estimator(self) -> CorrelationEstimator:
        """The rests and sources from which the memory of the noise is estimated."""
        linear, absorbed = self.fit.linear, [(cell.rests, cell.absorbing) for cell in self.cells]
        return CorrelationEstimator.from_rests(
            linear.rests, self.fit.noise.sources(linear.joints), absorbed
        )

    def clear_of_all(self, columns: F64) -> tuple[F64, F64]:
        """Return columns (N, m), whitened, and again clear of all that absorbs, the shapes
        included.
        """
        white = self.fit.noise.whiten(columns)
        cleared = clear_columns(white, self.cells)
        shared = self.cleared[:, :-1]
        return white, cleared - shared @ self.shared.explain(shared.T @ white)

    def clear_of_cells(self, columns: F64) -> F64:
        """Return columns (N, m), whitened and clear of what the cells' own columns absorb."""
        return clear_columns(self.fit.noise.whiten(columns), self.cells)

    @property
    def is_eliminated(self) -> Mask:
        """The fit's nuisance columns that are eliminated in cells of their own (a mask)."""
        eliminated: Mask = self.shared_number[: self.fit.layout.blocks.n] < 0
        return eliminated

    def without(self, part: int, fit: Fit) -> Projection:
        """Return the projection without the rests of a part.

        *fit*: of the shared columns, with a whitener that is zero in that part.
        """
        nothing = self.parts[part].without_rows()
        cleared_rows = self.cleared.copy()
        for cell in self.cells:
            if cell.part == part:
                cleared_rows[cell.rows] = 0.0
        return replace(
            self,
            fit=fit,
            cells=tuple(cell for cell in self.cells if cell.part != part),
            shared_number=self.shared_number[self.shared_number >= 0],
            parts=tuple(nothing if i == part else model for i, model in enumerate(self.parts)),
            cleared=cleared_rows,
            side=self.side * (np.arange(len(self.parts)) != part)[:, None],
        )

    def with_findings_of(self, fit: Fit) -> Projection:
        """Add a fit's findings and their shapes to what absorbs; there must be none yet."""
        start = fit.layout.identified.stop
        stop = fit.layout.mount.start
        shapes = make_shapes(fit, self.arm)
        added = np.hstack([fit.nuisance.columns.to_dense(slice(start, stop)), shapes.matrix])
        variance = np.concatenate([fit.nuisance.variance[start:stop], shapes.variance])
        white = fit.noise.whiten(added)
        cleared_added = clear_columns(white, self.cells)
        b, m = self.shared.layout.n, added.shape[1]
        all_clear = np.hstack([self.cleared[:, :-1], cleared_added, self.cleared[:, -1:]])
        products, squared_lengths = compute_products_of_parts(
            white, all_clear, self.cells, len(self.parts)
        )
        numbers = b + np.arange(m)
        findings, of_shapes = numbers[: stop - start], numbers[stop - start :]
        return replace(
            self,
            fit=fit,
            shapes=shapes,
            shared_number=np.concatenate(
                [self.shared_number[:start], findings, self.shared_number[start:], of_shapes]
            ),
            parts=tuple(
                model.add_block(
                    "findings and shapes",
                    part_products[:, b:-1],
                    part_products[:, :b].T,
                    variance,
                    length,
                )
                for model, part_products, length in zip(
                    self.parts, products, squared_lengths, strict=True
                )
            ),
            cleared=all_clear,
            side=np.hstack([self.side, products[:, :, -1]]),
        )

    def sums(self, signatures: Signatures) -> Sums:
        """Return the products with all candidates' columns: one pass over the rows, all parts as
        one.
        """
        cells = tuple(replace(cell, part=0) for cell in self.cells)
        side = self.side.sum(axis=0, keepdims=True)
        (joined,) = replace(self, cells=cells, parts=(self.shared,), side=side).sums_by_part(
            signatures
        )
        return joined

    def sums_by_part(self, signatures: Signatures) -> list[Sums]:
        """Return the products with all candidates' columns of each part by itself."""
        changes = self._changes(signatures)
        lengths, grams = self._grams(signatures, changes)
        products = self._products(signatures, changes, grams)
        return [
            Sums(
                signatures,
                self.parts[part],
                self.side[part],
                products[part, :, :-1].T,
                products[part, :, -1],
                lengths[part],
                {m: (members, gram[part]) for m, (members, gram) in grams.items()},
            )
            for part in range(len(self.parts))
        ]

    def _products(self, signatures: Signatures, changes: ArtefactColumns, grams: Grams) -> F64:
        """Return products (parts, K, b + 1) of all columns with the shared ones and the residual.

        What each cell's own columns absorb of a candidate's columns is subtracted from *grams* in
        place.
        """
        products = np.zeros((len(self.parts), signatures.n_columns, self.cleared.shape[1]))
        pairs = np.zeros((len(self.parts), signatures.n_pairs, self.cleared.shape[1]))
        for cell, pair_products in self._of_pairs(signatures):
            n_own = cell.absorbing.shape[1]
            pairs[cell.part] += pair_products[:, n_own:]
            absorbed = signatures.weights @ pair_products[:, :n_own]
            indices, change = changes.columns_in(cell)
            absorbed[indices] += change.T @ cell.absorbing
            products[cell.part, indices] += change.T @ self.cleared[cell.rows]
            for m, (members, gram) in grams.items():
                absorbed_columns = absorbed[signatures.first[members][:, None] + np.arange(m)]
                gram[cell.part] -= absorbed_columns @ absorbed_columns.transpose(0, 2, 1)
        for part, pair_products in enumerate(pairs):
            products[part] += signatures.weights @ pair_products
        return products

    def _of_pairs(self, signatures: Signatures) -> Iterator[tuple[Cell, F64]]:
        """Yield each cell with its `Signatures.of_pairs`.

        These are products with the cell's own columns, then the shared ones and the residual. Cells
        keep their order, so that sums do not depend on the number of processors.
        """

        def sum_cell(cell: Cell) -> F64:
            columns = np.hstack([cell.absorbing, self.cleared[cell.rows]])
            if not len(cell.rests):
                return np.zeros((signatures.n_pairs, columns.shape[1]))
            by_axis = columns.reshape(-1, 3, columns.shape[1])
            return signatures.of_pairs(self._at_rests[:, cell.rests], by_axis, cell.rests)

        return zip(self.cells, run_in_order(sum_cell, self.cells), strict=True)

    def sums_with(self, sums: Sums) -> Sums:
        """Return *sums* with the products of all candidates' columns with the remaining shared
        columns.

        *sums* holds the products with the first shared columns.
        """
        b = sums.bx.shape[0]
        signatures = sums.signatures
        added = self.cleared[:, b:-1]
        n = self.fit.linear.rests.n
        products = signatures.products(
            self._at_rests, added[: 3 * n].reshape(n, 3, -1), slice(None)
        )
        changes = self._changes(signatures)
        products[changes.columns] += changes.white.across(added)
        return replace(
            sums,
            shared=self.shared,
            br=self.side.sum(axis=0),
            bx=np.vstack([sums.bx, products.T]),
        )

    @cached_property
    def _at_rests(self) -> F64:
        """The whitened Jacobian (P, n, 3)."""
        at_rests = self.jacobian[:, : 3 * self.fit.linear.rests.n]
        return at_rests.reshape(len(self.jacobian), -1, 3)

    def _changes(self, signatures: Signatures) -> ArtefactColumns:
        """Return the columns that change the artefact."""
        noise, changes = self.fit.noise, signatures.changes
        having = np.array([i for i, change in enumerate(changes) if change], dtype=np.int64)
        blocks = self.fit.linear.artefact_columns([c for c in changes if c is not None])
        return ArtefactColumns(having, blocks.whitened(noise.whitener, noise.distance_mm))

    def _grams(self, signatures: Signatures, changes: ArtefactColumns) -> tuple[F64, Grams]:
        """Return the squared lengths (parts, K) of all columns, and the products within each
        candidate.
        """
        counts = map(int, np.unique(signatures.count))
        members = {m: np.flatnonzero(signatures.count == m) for m in counts}
        grams = {
            m: (numbers, np.zeros((len(self.parts), len(numbers), m, m)))
            for m, numbers in members.items()
        }
        for part, rests in self._rests_of_parts().items():
            for m, gram in signatures.grams(self._at_rests[:, rests], rests).items():
                grams[m][1][part] = gram
        lengths = np.zeros((len(self.parts), signatures.n_columns))
        for m, (numbers, gram) in grams.items():
            columns = signatures.first[numbers][:, None] + np.arange(m)
            for cell in self.cells:
                changes.add_products(cell, columns, gram[cell.part])
            lengths[:, columns] = np.einsum("pcii->pci", gram)
        return lengths, grams

    def _rests_of_parts(self) -> dict[int, slice | I64]:
        rests_of: dict[int, list[I64]] = {}
        for cell in self.cells:
            rests_of.setdefault(cell.part, []).append(cell.rests)
        return {part: as_slice(np.sort(np.concatenate(rests))) for part, rests in rests_of.items()}


def make_projection(fit: Fit, arm: Arm, part_of: I64 | None = None) -> Projection:
    """Make the projection of a fit; *part_of* (n,): the part of the data of each rest."""
    observations = fit.linear.rests.observations
    n, size = observations.n, len(fit.residual)
    part_of = np.zeros(n, dtype=np.int64) if part_of is None else part_of
    parts = int(part_of.max(initial=0)) + 1
    shapes = make_shapes(fit, arm)
    variance = np.concatenate([fit.nuisance.variance, shapes.variance])
    white = fit.nuisance.columns.whitened(fit.noise.whitener, fit.noise.distance_mm)
    # Certified distances belong to no placement: they are a part that is never left out.
    none = np.empty(0, dtype=np.int64)
    at_distances = np.flatnonzero(white.distances.any(axis=0))
    of_distances = Piece(none, at_distances, white.distances[:, None, at_distances])
    places = [*split_by_part(white, part_of), (parts, of_distances)]
    touched = np.zeros(len(variance), dtype=np.int64)
    for _, piece in places:
        touched[piece.columns] += 1
    may_be_own = np.zeros(len(variance), dtype=bool)
    may_be_own[: fit.layout.identified.start] = True
    may_be_own[fit.layout.drift] = True
    local = may_be_own & (touched <= 1)
    cells = []
    for part, piece in places:
        is_local = local[piece.columns]
        rows_of_cell = to_rows(piece.values[:, :, is_local])
        local_model = LinearModel.from_rows(
            [("own", rows_of_cell, variance[piece.columns[is_local]])]
        )
        rows = slice(3 * n, size) if piece is of_distances else as_slice(list_rows(piece.rests))
        cells.append(Cell(part, piece.rests, rows, rows_of_cell @ local_model.factor))
    common = white.to_dense(np.flatnonzero(~local[: white.size]))
    always_shared = fit.noise.whiten(np.hstack([shapes.matrix, fit.residual[:, None]]))
    shared = np.hstack([common, always_shared])
    cleared_shared = clear_columns(shared, cells)
    products, squared_lengths = compute_products_of_parts(
        shared[:, :-1], cleared_shared, cells, parts + 1
    )
    layout = Layout((*fit.layout.blocks.sizes, ("shapes", shapes.matrix.shape[1])))
    layout = layout.only(np.flatnonzero(~local))
    return Projection(
        fit=fit,
        arm=arm,
        shapes=shapes,
        cells=tuple(cells),
        jacobian=np.ascontiguousarray(fit.noise.whiten(fit.linear.jacobian.T).T),
        shared_number=np.where(local, -1, np.cumsum(~local) - 1),
        parts=tuple(
            LinearModel.from_products(
                layout, part_products[:, :-1], variance[~local], squared_norm=length
            )
            for part_products, length in zip(products, squared_lengths, strict=True)
        ),
        cleared=cleared_shared,
        side=products[:, :, -1],
    )

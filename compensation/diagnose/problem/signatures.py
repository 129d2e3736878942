"""Candidates as columns: what each would add to the residual, and products with others."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import SIGNATURES_PIECE
from armd.compensation.diagnose.problem.linear import Linear
from armd.compensation.diagnose.problem.pairs import Part, Within
from armd.compensation.diagnose.problem.use import evaluate_histories
from armd.compensation.effects.effect import ArtefactChange, Candidate, Use, Winding
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.terms import Factor, Term


@dataclass(frozen=True, kw_only=True)
class Signatures:
    """The K columns of many candidates: their parameters, weights and basis functions."""

    candidates: tuple[Candidate, ...]
    first: I64  # (candidates,) first column of each
    count: I64
    parts: tuple[tuple[Part, ...], ...]  # per column
    changes: tuple[ArtefactChange | None, ...]  # per column
    keys: tuple[str, ...]  # (B,) text that identifies a basis function
    bases: F64  # (B, n) basis values
    prior_sd: F64  # (K,)
    reach: F64  # (K,)

    @property
    def n_columns(self) -> int:
        return len(self.parts)

    @cached_property
    def kinds(self) -> tuple[tuple[str, ...], ...]:
        """The `identify_kind` of each candidate."""
        return tuple(map(identify_kind, self.candidates))

    def columns_of(self, candidate: int) -> range:
        """Return the column numbers of a candidate."""
        return range(self.first[candidate], self.first[candidate] + self.count[candidate])

    def rows(self, linear: Linear, columns: I64) -> F64:
        """Return columns as rows (len(columns), N), in mm."""
        stacked = self.rows_of_terms(linear, linear.jacobian, columns)
        for row, column in zip(stacked, columns, strict=True):
            if (change := self.changes[column]) is not None:
                row += linear.artefact_column(change)
        return stacked

    def rows_of_terms(self, linear: Linear, jacobian: F64, columns: I64) -> F64:
        """Return columns as rows without changes of the artefact, from any Jacobian (P, N).

        The Jacobian may be whitened.
        """
        n = 3 * linear.rests.n
        rows = np.zeros((len(columns), len(linear.residual)))
        at_rests = rows[:, :n].reshape(len(columns), -1, 3)
        of_rests = jacobian[:, :n].reshape(len(jacobian), -1, 3)
        for turn in range(max((len(self.parts[c]) for c in columns), default=0)):
            having = [i for i, c in enumerate(columns) if len(self.parts[c]) > turn]
            named, weights, bases = zip(
                *(self.parts[columns[i]][turn] for i in having), strict=True
            )
            values = np.array(weights)[:, None] * self.bases[list(bases)]
            if turn == 0 and len(having) == len(columns):
                np.multiply(of_rests[list(named)], values[:, :, None], out=at_rests)
            else:
                at_rests[having] += of_rests[list(named)] * values[:, :, None]
        return rows

    def products(self, jacobian: F64, vectors: F64, rests: slice | I64) -> F64:
        """Return products (K, u) of the columns with *vectors* (n, 3, u) over some *rests*.

        Changes of the artefact are not included. *jacobian* (P, n, 3) is of these rests.
        """
        product: F64 = self.weights @ self.of_pairs(jacobian, vectors, rests)
        return product

    def of_pairs(self, jacobian: F64, vectors: F64, rests: slice | I64) -> F64:
        """Return products (pairs, u) with *vectors* of each parameter with each of its bases.

        A column is a parameter's column times a basis function. The vectors are multiplied by the
        parameter's column once for all its bases, and three rows become one.
        """
        named, first, basis, _ = self._pairs
        values = self.bases[:, rests]
        sums = np.zeros((len(basis), vectors.shape[2]))
        for begin in range(0, len(vectors), SIGNATURES_PIECE):
            piece = slice(begin, begin + SIGNATURES_PIECE)
            turned = jacobian[named, piece].transpose(1, 0, 2) @ vectors[piece]  # (·, named, u)
            for j, (low, high) in enumerate(itertools.pairwise(first)):
                sums[low:high] += values[basis[low:high], piece] @ turned[:, j]
        return sums

    def grams(self, jacobian: F64, rests: slice | I64) -> dict[int, F64]:
        """Return products (c, m, m) within each candidate, by its number m of columns.

        They are sums over some *rests*, and zero where a candidate changes the artefact. *jacobian*
        (P, n, 3) is whitened and of these rests.
        """
        elements = self._within.products(jacobian, self.bases[:, rests])
        grams = {}
        for m in map(int, np.unique(self.count)):
            i, j = np.triu_indices(m)
            first = self._within.first[self.count == m]
            gram = np.zeros((len(first), m, m))
            gram[:, i, j] = gram[:, j, i] = elements[first[:, None] + np.arange(len(i))]
            grams[m] = gram
        return grams

    def with_more(self, added: Signatures) -> Signatures:
        """Append the candidates of *added* to these.

        Basis functions that both have are shared. With many readings a copy of all takes hundreds
        of megabytes.
        """
        keys, values = list(self.keys), [self.bases]
        for key, row in zip(added.keys, added.bases, strict=True):
            if key not in keys:
                keys.append(key)
                values.append(row[None])
        positions = [keys.index(key) for key in added.keys]
        parts = [
            tuple(
                (parameter, weight, positions[basis]) for parameter, weight, basis in column_parts
            )
            for column_parts in added.parts
        ]
        return Signatures(
            candidates=(*self.candidates, *added.candidates),
            first=np.concatenate([self.first, added.first + self.n_columns]),
            count=np.concatenate([self.count, added.count]),
            parts=(*self.parts, *parts),
            changes=(*self.changes, *added.changes),
            keys=tuple(keys),
            bases=np.concatenate(values) if len(values) > 1 else self.bases,
            prior_sd=np.concatenate([self.prior_sd, added.prior_sd]),
            reach=np.concatenate([self.reach, added.reach]),
        )

    @cached_property
    def _within(self) -> Within:
        columns = [[self.parts[c] for c in self.columns_of(i)] for i in range(len(self.first))]
        return Within.from_candidates(columns)

    @property
    def n_pairs(self) -> int:
        """The number of rows of `of_pairs`."""
        return len(self._pairs[2])

    @property
    def weights(self) -> csr_array:
        """The weights (K, pairs) with which pairs make the columns."""
        return self._pairs[3]

    @cached_property
    def _pairs(self) -> tuple[I64, I64, I64, csr_array]:
        """The distinct pairs of parameter and basis, ordered by parameter.

        Returns the parameters, where the pairs of each begin (one more for the end), the bases of
        all pairs, and the weights (K, pairs) with which pairs make the columns.
        """
        entries = [
            (parameter, basis, column, weight)
            for column, parts in enumerate(self.parts)
            for parameter, weight, basis in parts
        ]
        parameter, basis, column = (
            np.array([e[:3] for e in entries], dtype=np.int64).reshape(-1, 3).T
        )
        pairs, index = np.unique(parameter * len(self.bases) + basis, return_inverse=True)
        parameters_of, bases_of = np.divmod(pairs, max(len(self.bases), 1))
        named, first = np.unique(parameters_of, return_index=True)
        weights = csr_array(
            ([e[3] for e in entries], (column, index)),
            shape=(self.n_columns, len(pairs)),
            dtype=np.float64,
        )
        return named, np.append(first, len(pairs)), bases_of, weights


def identify_kind(candidate: Candidate) -> tuple[str, ...]:
    """Return what candidates share that differ only in the value of a setting."""
    columns = (column.name for column in candidate.columns)
    return (*candidate.place, *columns, *(name for name, *_ in candidate.setting))


def compile_candidates(candidates: Sequence[Candidate], linear: Linear, arm: Arm) -> Signatures:
    """Evaluate each distinct basis once, and express every column by its parts."""
    layout = arm.layout
    basis_of: dict[str, int] = {}
    bases: list[list[Factor] | Use | Winding] = []

    def number(key: str, basis: list[Factor] | Use | Winding) -> int:
        if key not in basis_of:
            basis_of[key] = len(bases)
            bases.append(basis)
        return basis_of[key]

    parts: list[tuple[Part, ...]] = []
    changes: list[ArtefactChange | None] = []
    prior_sd, reach, first, count = [], [], [], []
    for candidate in candidates:
        if len({column.artefact is None for column in candidate.columns}) > 1:
            raise ValueError(f"{candidate.cause}: some columns change the artefact, others do not")
        first.append(len(parts))
        count.append(len(candidate.columns))
        for column in candidate.columns:
            of_column = []
            for term in column.terms:
                key = "·".join(factor.model_dump_json() for factor in term.basis)
                index = number(key, term.basis)
                of_column.append((layout.index(term.parameter), term.coefficient, index))
            if (use := column.use) is not None:
                index = number(repr(replace(use, parameters=())), use)
                of_column += [
                    (layout.index(name), weight, index) for name, weight in use.parameters
                ]
            parts.append(tuple(of_column))
            changes.append(column.artefact)
            prior_sd.append(column.prior_sd)
            reach.append(column.reach)
    model = linear.model
    states = linear.rests.observations.states
    histories = {
        i: history for i, history in enumerate(bases) if isinstance(history, Use | Winding)
    }
    probes = {
        i: Term(parameter="theta_1", basis=history, coefficient=1.0)
        for i, history in enumerate(bases)
        if not isinstance(history, Use | Winding)
    }
    values = np.empty((len(bases), states.n))
    values[list(probes)] = compute_basis_values(
        [*probes.values()], states, arm, model.reference_c, model.constants
    ).T
    if histories:
        rests = linear.rests
        of_points = evaluate_histories([*histories.values()], rests.points.states)
        values[list(histories)] = of_points[:, rests.point_of]
    np.nan_to_num(values, copy=False)  # with many readings a copy takes hundreds of megabytes
    return Signatures(
        candidates=tuple(candidates),
        first=np.array(first, dtype=np.int64),
        count=np.array(count, dtype=np.int64),
        parts=tuple(parts),
        changes=tuple(changes),
        keys=tuple(basis_of),
        bases=values,
        prior_sd=np.array(prior_sd),
        reach=np.array(reach),
    )


def make_finding_columns(linear: Linear, findings: Sequence[Candidate], arm: Arm) -> list[F64]:
    """Return the columns (N, m) of each finding, in mm."""
    signatures = compile_candidates(findings, linear, arm)
    return [
        signatures.rows(linear, np.array(signatures.columns_of(i))).T for i in range(len(findings))
    ]

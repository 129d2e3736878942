"""Products of the columns within each candidate, computed without the columns themselves.

A column is a sum of parts; a part is a parameter's column times a basis function. A product of two
columns is therefore a sum over the rests of (J_p · J_q) × (b_a b_c), with p, q two parameters and
a, c two basis functions. A catalogue has thousands of columns but few such pairs, and a pair needs
one number for each rest where a column has three.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from armd.arrays import F64, I64
from armd.compensation.data.in_order import run_in_order
from armd.compensation.diagnose.constants import MANY_INDICES, PAIRS_CHUNK, PAIRS_PIECE

Part = tuple[int, float, int]  # parameter, weight, row of the bases


@dataclass(frozen=True)
class Within:
    """The products of parts from which products within the requested candidates are made."""

    parameters: I64  # (D, 2) pairs of parameters
    groups: tuple[tuple[I64, I64], ...]  # pairs of bases (g, 2) with the same parameter pairs (d,)
    first: I64  # (candidates,) index of the first element of each
    weights: csr_array  # (elements, quadruples) in the order of the groups, bases first

    @classmethod
    def from_candidates(cls, candidates: Sequence[Sequence[Sequence[Part]]]) -> Within:
        """Find the products that the columns of each candidate need, given by their parts.

        The elements of a candidate are its upper triangle, row by row.
        """
        count = np.array([len(c) * (len(c) + 1) // 2 for c in candidates], dtype=np.int64)
        first = np.cumsum(count) - count
        rows, part_a, part_b = _elements(candidates, first)
        flat = [part for columns in candidates for column in columns for part in column]
        parameter, weight, basis = np.array(flat, dtype=np.float64).reshape(len(flat), 3).T
        named, number = np.unique(_pair(parameter[part_a], parameter[part_b]), return_inverse=True)
        met = _pair(basis[part_a], basis[part_b]) * len(named) + number
        quadruples, met_at = np.unique(met, return_inverse=True)
        bases, those = np.divmod(quadruples, max(len(named), 1))
        pairs, begin = np.unique(bases, return_index=True)
        end = np.append(begin, len(bases))[1:]
        alike: dict[bytes, list[int]] = {}
        for k, (low, high) in enumerate(zip(begin, end, strict=True)):
            alike.setdefault(those[low:high].tobytes(), []).append(k)
        place, groups, total = np.empty(len(quadruples), dtype=np.int64), [], 0
        for group in alike.values():
            low, high = begin[group[0]], end[group[0]]
            positions = begin[group][:, None] + np.arange(high - low)
            place[positions] = total + np.arange(positions.size).reshape(positions.shape)
            total += positions.size
            groups.append((_split_pairs(pairs[group]), those[low:high]))
        return cls(
            _split_pairs(named),
            tuple(groups),
            first,
            csr_array(
                ((weight[part_a] * weight[part_b]).tolist(), (rows, place[met_at])),
                shape=(int(count.sum()), len(quadruples)),
                dtype=np.float64,
            ),
        )

    def products(self, jacobian: F64, bases: F64) -> F64:
        """Return the elements (elements,), by a whitened Jacobian (P, n, 3) and bases (B, n)."""
        parameter_a, parameter_b = self.parameters.T

        def sum_piece(begin: int) -> F64:
            piece = slice(begin, begin + PAIRS_PIECE)
            columns, values = jacobian[:, piece], np.ascontiguousarray(bases[:, piece])
            of_parameters = np.einsum("dna,dna->dn", columns[parameter_a], columns[parameter_b])
            sums = [np.empty(0)]
            for group, those in self.groups:
                turned = of_parameters[those].T
                for low in range(0, len(group), PAIRS_CHUNK):
                    a, c = group[low : low + PAIRS_CHUNK].T
                    sums.append(((values[a] * values[c]) @ turned).ravel())
            return np.concatenate(sums)

        total = np.zeros(self.weights.shape[1])
        for sums in run_in_order(sum_piece, range(0, bases.shape[1], PAIRS_PIECE)):
            total += sums
        elements: F64 = self.weights @ total
        return elements


def _elements(candidates: Sequence[Sequence[Sequence[Part]]], first: I64) -> tuple[I64, I64, I64]:
    """List all products of two parts: the element that each adds to, and both parts.

    Elements are numbered along the rows of the upper triangle, those of a candidate beginning at
    *first*. Parts are numbered through all candidates.
    """
    sizes = [tuple(map(len, columns)) for columns in candidates]
    begin = np.cumsum([0, *map(sum, sizes)])
    alike: dict[tuple[int, ...], list[int]] = {}
    for k, size in enumerate(sizes):
        alike.setdefault(size, []).append(k)
    tables = [np.empty((3, 0), dtype=np.int64)]
    for size, members in alike.items():
        column, m = np.repeat(np.arange(len(size)), size), len(size)
        i, j = np.nonzero(column[:, None] <= column)
        low, high = column[i], column[j]
        element = low * m - low * (low - 1) // 2 + high - low
        parts = begin[members][:, None]
        tables.append(
            np.stack([first[members][:, None] + element, parts + i, parts + j]).reshape(3, -1)
        )
    rows, part_a, part_b = np.hstack(tables)
    return rows, part_a, part_b


def _pair(a: F64, b: F64) -> I64:
    """Return one number for a pair of numbers, the same in either order."""
    pair: I64 = np.minimum(a, b).astype(np.int64) * MANY_INDICES + np.maximum(a, b).astype(np.int64)
    return pair


def _split_pairs(pairs: I64) -> I64:
    """Return the two numbers (…, 2) of each pair."""
    return np.stack(np.divmod(pairs, MANY_INDICES), axis=-1)

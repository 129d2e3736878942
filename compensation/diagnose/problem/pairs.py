"""Products of candidates' columns within each candidate, without the columns.

A column is a sum of parts, a parameter's column times a basis function. A product of two columns is
therefore a sum over the rests of (J_p · J_q) × (b_a b_c): of two parameters, and of two basis
functions. A catalogue has thousands of columns and few such pairs, and one number for each rest
stands where a column has three.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from armd.arrays import F64, I64
from armd.compensation.data.in_order import in_order

Part = tuple[int, float, int]  # parameter, weight, row of the bases

CHUNK = 256  # pairs of basis functions at once, at
PIECE = 1024  # so many rests: what stays in the processor's cache


@dataclass(frozen=True)
class Within:
    """Which products make those within the candidates that are asked for."""

    parameters: I64  # (D, 2) pairs of parameters
    groups: tuple[tuple[I64, I64], ...]  # pairs of bases (g, 2) that meet the same of these (d,)
    first: I64  # (candidates,) where the elements of each begin
    weights: csr_array  # (elements, quadruples) in the order of the groups, bases first

    @classmethod
    def of(cls, candidates: Sequence[Sequence[Sequence[Part]]]) -> Within:
        """Of the columns of each candidate, by their parts; elements are the upper triangles, row
        by row."""
        elements: list[tuple[int, tuple[int, int], tuple[int, int], float]] = []
        first, count = [], 0
        for columns in candidates:
            first.append(count)
            for i, own in enumerate(columns):
                for other in columns[i:]:
                    elements += [
                        (count, (min(a, c), max(a, c)), (min(p, q), max(p, q)), v * w)
                        for p, v, a in own
                        for q, w, c in other
                    ]
                    count += 1
        met: dict[tuple[int, int], set[tuple[int, int]]] = {}
        for _, bases, parameters, _ in elements:
            met.setdefault(bases, set()).add(parameters)
        number = {pair: k for k, pair in enumerate(sorted(set().union(*met.values())))}
        alike: dict[tuple[int, ...], list[tuple[int, int]]] = {}
        for bases, of in met.items():
            alike.setdefault(tuple(sorted(number[pair] for pair in of)), []).append(bases)
        at, quadruples = {}, 0
        for those, group in alike.items():
            for bases in group:
                for k in those:
                    at[bases, k] = quadruples
                    quadruples += 1
        rows = [element for element, *_ in elements]
        columns_of = [at[bases, number[pair]] for _, bases, pair, _ in elements]
        return cls(
            np.array(list(number), dtype=np.int64).reshape(-1, 2),
            tuple((np.array(group), np.array(those)) for those, group in alike.items()),
            np.array(first, dtype=np.int64),
            csr_array(
                ([weight for *_, weight in elements], (rows, columns_of)),
                shape=(count, quadruples),
                dtype=np.float64,
            ),
        )

    def products(self, jacobian: F64, bases: F64) -> F64:
        """(elements,) over n rests, from a whitened Jacobian (P, n, 3) and basis values (B, n)."""
        one, other = self.parameters.T

        def of(begin: int) -> F64:
            some = slice(begin, begin + PIECE)
            columns, values = jacobian[:, some], np.ascontiguousarray(bases[:, some])
            of_parameters = np.einsum("dna,dna->dn", columns[one], columns[other])
            found = [np.empty(0)]
            for group, those in self.groups:
                turned = of_parameters[those].T
                for low in range(0, len(group), CHUNK):
                    a, c = group[low : low + CHUNK].T
                    found.append(((values[a] * values[c]) @ turned).ravel())
            return np.concatenate(found)

        total = np.zeros(self.weights.shape[1])
        for found in in_order(of, range(0, bases.shape[1], PIECE)):
            total += found
        elements: F64 = self.weights @ total
        return elements

"""Candidates as columns: what each would add to the residual, whitened, chunk by chunk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.compensation import parameters
from armd.compensation.arm import Arm
from armd.compensation.basis import basis_values
from armd.compensation.diagnose.noise import Noise
from armd.compensation.diagnose.problem import Linear
from armd.compensation.effects.effect import ArtefactChange, Candidate
from armd.compensation.terms import Factor, Term

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

Part = tuple[int, float, int]  # parameter, weight, row of the bases


@dataclass(frozen=True)
class Signatures:
    """K columns of many candidates: which parameters, weights and basis functions make them."""

    candidates: tuple[Candidate, ...]
    first: I64  # (candidates,) first column of each
    count: I64
    parts: tuple[tuple[Part, ...], ...]  # per column
    changes: tuple[ArtefactChange | None, ...]  # per column
    bases: F64  # (B, n) basis values
    typical: F64  # (K,)
    reach: F64  # (K,)

    @property
    def n_columns(self) -> int:
        return len(self.parts)

    def columns_of(self, candidate: int) -> range:
        """Column numbers of a candidate."""
        return range(self.first[candidate], self.first[candidate] + self.count[candidate])

    def block(
        self, linear: Linear, jacobian: F64, columns: range, noise: Noise | None = None
    ) -> F64:
        """Columns (N, len(columns)) from a Jacobian (P, N): plain, or whitened with its noise."""
        rows = np.zeros((len(columns), len(linear.residual)))
        n = 3 * linear.rests.n
        for row, column in zip(rows, columns, strict=True):
            if (change := self.changes[column]) is not None:
                plain = linear.artefact_column(change)
                row[:] = plain if noise is None else noise.whiten(plain)
            for parameter, weight, basis in self.parts[column]:
                row[:n] += jacobian[parameter, :n] * np.repeat(weight * self.bases[basis], 3)
        return rows.T


def compile_candidates(candidates: Sequence[Candidate], linear: Linear, arm: Arm) -> Signatures:
    """Evaluate each distinct basis once, and say every column by its parts."""
    index = {name: i for i, name in enumerate(parameters.names(arm.n_joints))}
    basis_of: dict[str, int] = {}
    bases: list[list[Factor]] = []
    parts: list[tuple[Part, ...]] = []
    changes: list[ArtefactChange | None] = []
    typical, reach, first, count = [], [], [], []
    for candidate in candidates:
        first.append(len(parts))
        count.append(len(candidate.columns))
        for column in candidate.columns:
            of_column = []
            for term in column.terms:
                key = "·".join(factor.model_dump_json() for factor in term.basis)
                if key not in basis_of:
                    basis_of[key] = len(bases)
                    bases.append(term.basis)
                of_column.append((index[term.parameter], term.coefficient, basis_of[key]))
            parts.append(tuple(of_column))
            changes.append(column.artefact)
            typical.append(column.typical)
            reach.append(column.reach)
    probes = [Term(parameter="theta_1", basis=basis, coefficient=1.0) for basis in bases]
    model = linear.model
    states = linear.rests.observations.states
    values = basis_values(probes, states, arm, model.reference_c, model.constants)
    return Signatures(
        tuple(candidates),
        np.array(first, dtype=np.int64),
        np.array(count, dtype=np.int64),
        tuple(parts),
        tuple(changes),
        np.ascontiguousarray(np.nan_to_num(values.T)),
        np.array(typical),
        np.array(reach),
    )

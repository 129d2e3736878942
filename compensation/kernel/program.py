"""Translate a calibration's terms for the kernel: index, coefficient, factor codes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import F64
from armd.compensation.kernel import pose_factors as codes
from armd.compensation.kernel.memory import FlatModel, Folded, Program
from armd.compensation.model.arm import Arm
from armd.compensation.model.gravity import STANDARD_GRAVITY, list_link_masses
from armd.compensation.model.parameters import PER_JOINT, ParameterLayout
from armd.compensation.model.pose_factors import PoseFactor
from armd.compensation.model.terms import Term


def order_by_parameter(terms: Sequence[Term], n_joints: int) -> list[Term]:
    """Sort terms by the parameters they change, as a `Program` needs its pose terms."""
    layout = ParameterLayout(n_joints)
    return sorted(terms, key=lambda term: layout.index(term.parameter))


def compile_terms(terms: Sequence[Term], arm: Arm) -> Program:
    """Compile pose terms, in the order of `order_by_parameter`, to a program."""
    layout = arm.layout
    parameter = np.array(layout.indices(term.parameter for term in terms), dtype=np.int64)
    groups = [*range(0, layout.tip.start, PER_JOINT), layout.tip.start, layout.base.start]
    groups.append(layout.count)
    distinct: dict[str, int] = {}
    rows: list[tuple[int, int, int]] = []
    pieces: list[int] = []
    curves: list[F64] = [np.zeros((0, 4))]
    factor_first, term_factors = [0], []
    for term in terms:
        for factor in term.basis:
            if not isinstance(factor, PoseFactor):
                continue
            key = factor.model_dump_json()
            if key not in distinct:
                distinct[key] = len(rows)
                kind, number, detail = factor.pose_code(sum(map(len, curves)))
                rows.append((codes.KINDS.index(kind), number, detail))
                curves.append(factor.table())
                pieces.append(len(curves[-1]))
            term_factors.append(distinct[key])
        factor_first.append(len(term_factors))
    kinds = {kind for kind, _, _ in rows}
    levers = bool(kinds & {codes.TORQUE, codes.MOMENT})
    down = levers or codes.DIRECTION in kinds
    toward = codes.APPROACH_TIP in kinds
    return Program(
        parameter=parameter,
        first=np.searchsorted(parameter, groups).astype(np.int64),
        factor_first=np.array(factor_first, dtype=np.int64),
        term_factors=np.array(term_factors, dtype=np.int64),
        factors=np.array(rows, dtype=np.int64).reshape(-1, 3),
        curves=np.ascontiguousarray(np.vstack(curves)),
        curve_pieces=np.array(pieces, dtype=np.int64),
        gravity=_gravity(arm),
        needs=np.array([levers, down, toward], dtype=np.int64),
    )


def pack_program(program: Program, constants: F64) -> FlatModel:
    """Pack a model for the kernel, for samples one by one, still to be folded; *constants* (P,).

    One by one, because a live sample comes alone, to cold caches: scratch for 64 samples is 50 KB.
    """
    n = ParameterLayout.from_count(len(constants)).n_joints
    n_terms, n_factors = len(program.parameter), len(program.factors)
    matrices = np.zeros((n + 1, 3, 4))
    folded = Folded(matrices, matrices, constants, constants, np.zeros(n_terms))
    sizes = [n, n_terms, n_factors, len(program.curves), len(program.term_factors)]
    integers, floats = program[:7], program[7:]
    rows = 3 * n + 25 + n_factors + 3 * (3 * n + 3)
    return FlatModel(
        sizes=np.concatenate([np.array(sizes), *(array.ravel() for array in integers)]),
        numbers=np.concatenate([array.ravel() for array in (*folded, *floats)]),
        work=np.zeros((rows, 1)),
    )


def _gravity(arm: Arm) -> F64:
    """Return `Program.gravity`, masses scaled so that mass moment × unit gravity is in Nm."""
    kg, centre_mm = list_link_masses(arm)
    newton_per_mm = STANDARD_GRAVITY / 1000
    table = np.zeros((arm.n_joints + 1, 4))
    table[0, :3] = arm.gravity
    table[1:, :3] = kg[:, None] * centre_mm * newton_per_mm
    table[1:, 3] = np.cumsum(kg[::-1])[::-1] * newton_per_mm
    return table

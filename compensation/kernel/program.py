"""A calibration's terms, translated for the kernel: index, coefficient, factor codes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from armd.compensation.kernel import pose_factors as codes
from armd.compensation.kernel.memory import Folded, Program, State
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import AXES, curve_spline
from armd.compensation.model.gravity import STANDARD_GRAVITY, link_masses
from armd.compensation.model.parameters import PER_JOINT, ParameterLayout
from armd.compensation.model.terms import (
    SLOW_FACTORS,
    Angle,
    Approach,
    Curve,
    Factor,
    GravityDirection,
    GravityMoment,
    GravityTorque,
    Harmonic,
    Rate,
    Side,
    Term,
)

F64 = npt.NDArray[np.float64]


def by_parameter(terms: Sequence[Term], n_joints: int) -> list[Term]:
    """Terms in the order of the parameters they change, as a `Program` wants its pose terms."""
    layout = ParameterLayout(n_joints)
    return sorted(terms, key=lambda term: layout.index(term.parameter))


def compile_terms(terms: Sequence[Term], arm: Arm) -> Program:
    """The program of pose terms, which stand in the order of `by_parameter`."""
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
            if isinstance(factor, SLOW_FACTORS):
                continue
            key = factor.model_dump_json()
            if key not in distinct:
                distinct[key] = len(rows)
                rows.append(_code(factor, sum(map(len, curves))))
                pieces.append(len(factor.values) if isinstance(factor, Curve) else 0)
                if isinstance(factor, Curve):
                    curves.append(curve_spline(factor.values).c[::-1].T)
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


def state_of(program: Program, constants: F64) -> State:
    """A model's state for the kernel, for samples one by one, still to be folded; *constants* (P,).

    One by one, because a live sample comes alone, to cold caches: 64 wide the scratch is 50 KB.
    """
    n = ParameterLayout.of(len(constants)).n_joints
    n_terms, n_factors = len(program.parameter), len(program.factors)
    matrices = np.zeros((n + 1, 3, 4))
    folded = Folded(matrices, matrices, constants, constants, np.zeros(n_terms))
    sizes = [n, n_terms, n_factors, len(program.curves), len(program.term_factors)]
    integers, floats = program[:7], program[7:]
    rows = 3 * n + 25 + n_factors + 3 * (3 * n + 3)
    return State(
        sizes=np.concatenate([np.array(sizes), *(array.ravel() for array in integers)]),
        numbers=np.concatenate([array.ravel() for array in (*folded, *floats)]),
        work=np.zeros((rows, 1)),
    )


def _code(factor: Factor, curve_at: int) -> tuple[int, int, int]:
    """Kind, joint or link from 0, and detail of a pose factor."""
    match factor:
        case Harmonic():
            return (
                codes.SIN if factor.kind == "sin" else codes.COS,
                factor.joint - 1,
                factor.order,
            )
        case Angle():
            return codes.ANGLE, factor.joint - 1, factor.power
        case Curve():
            return codes.CURVE, factor.joint - 1, curve_at
        case GravityTorque():
            return codes.TORQUE, factor.joint - 1, 0
        case GravityDirection():
            return codes.DIRECTION, factor.link - 1, AXES.index(factor.axis)
        case GravityMoment():
            return codes.MOMENT, factor.link - 1, AXES.index(factor.axis)
        case Side():
            return codes.SIDE, factor.joint - 1, 0
        case Rate():
            return codes.RATE, factor.joint - 1, 0
        case Approach():
            kind = codes.APPROACH if factor.frame == "base" else codes.APPROACH_TIP
            return kind, 0, AXES.index(factor.axis)
        case _:
            raise AssertionError(f"{factor.kind} is no pose factor")


def _gravity(arm: Arm) -> F64:
    """`Program.gravity`, masses scaled so that mass moment × unit gravity is in Nm."""
    kg, centre_mm = link_masses(arm)
    newton_per_mm = STANDARD_GRAVITY / 1000
    table = np.zeros((arm.n_joints + 1, 4))
    table[0, :3] = arm.gravity
    table[1:, :3] = kg[:, None] * centre_mm * newton_per_mm
    table[1:, 3] = np.cumsum(kg[::-1])[::-1] * newton_per_mm
    return table

"""Compute the values of terms' bases at each reading, with numpy arrays.

Identification and diagnosis use this module. The kernel evaluates the same functions block by block
for the live path; a test compares the two.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.instants import Delay, Instants
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term


def compute_basis_values(
    terms: Sequence[Term],
    states: States,
    arm: Arm,
    reference_c: float,
    constants: F64,
    delay: Delay | None = None,
) -> F64:
    """Compute the product (n, T) of each term's factors at each row.

    *constants* (P,) pose the gravity factors and the tip's frame. A missing rate or approach
    contributes nothing (0); a missing temperature or time gives NaN. Lags are followed within each
    series of *states*, unless the live path passes its own *delay*.
    """
    instants = Instants(states, arm, reference_c, constants, delay)
    factor_values: dict[str, F64] = {}  # each distinct factor is evaluated once
    values = np.ones((len(terms), states.n))  # each contiguous in memory
    for t, term in enumerate(terms):
        for factor in term.basis:
            key = factor.model_dump_json()
            if key not in factor_values:
                factor_values[key] = factor.evaluate(instants)
            values[t] *= factor_values[key]
    return values.T


def compute_tip_motion(
    terms: Sequence[Term], states: States, arm: Arm, reference_c: float, constants: F64, jac: F64
) -> F64:
    """Compute how far terms move the tip (n, 3) mm, to first order.

    *jac* (n, 3, P) is the tip's Jacobian. Terms with a missing temperature or time move nothing.
    """
    values = np.nan_to_num(compute_basis_values(terms, states, arm, reference_c, constants))
    moved = np.zeros(jac.shape[:2])
    for term, value in zip(terms, values.T, strict=True):
        moved += term.coefficient * value[:, None] * jac[:, :, arm.layout.index(term.parameter)]
    return moved


def compute_parameter_rows(constants: F64, terms: Sequence[Term], values: F64) -> F64:
    """Compute parameters (n, P) of each row: *constants* (P,) + Σ coefficient · *values* (n, T)."""
    layout = ParameterLayout.from_count(len(constants))
    rows = np.tile(constants, (len(values), 1))
    for term, value in zip(terms, values.T, strict=True):
        rows[:, layout.index(term.parameter)] += term.coefficient * value
    return rows

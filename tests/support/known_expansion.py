"""A calibration of the drawing's geometry whose links expand by a coefficient."""

from __future__ import annotations

from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration, name_constants
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from support.drawn import drawn


def known_expansion(arm: Arm, expansion_per_k: float) -> Calibration:
    """One term per length of each link that has a temperature, known to a tenth."""
    constants = name_constants(arm.nominal(), arm.n_joints)
    terms = [
        Term(
            parameter=name,
            basis=[Temperature(weights=joint.weights)],
            coefficient=expansion_per_k * constants[name],
        )
        for k, joint in enumerate(arm.joint, 1)
        for name in (f"d_{k}", f"a_{k}")
        if joint.weights and constants[name]
    ]
    n = len(terms)
    tenths = [0.1 * abs(term.coefficient) for term in terms]
    return drawn(
        arm,
        reference_temperature_c=arm.reference_temperature_c,
        temperature_range_c=dict.fromkeys(arm.used_sensors, (10.0, 40.0)),
        terms=terms,
        covariance_of=[f"term {i}" for i in range(n)],
        covariance=[[tenths[i] ** 2 * (i == j) for j in range(n)] for i in range(n)],
    )

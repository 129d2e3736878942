"""A calibration without a measurement: the drawing's geometry, the links' handbook expansion.

It corrects what is known of the links' materials and nothing else; its provenance says so, and
its covariance leaves out how far the true geometry is from the drawing.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence

import numpy as np

from armd.compensation.model import parameters
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration, Noise, constants_of
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term


def known_expansion(
    arm: Arm,
    expansion_per_k: Sequence[float],
    *,
    relative_uncertainty: float = 0.1,
    temperature_range_c: tuple[float, float] = (10.0, 40.0),
) -> Calibration:
    """Constants of arm.toml and one linear term per length of each link that has a temperature.

    *expansion_per_k* (N,) in 1/K, one per link, known to *relative_uncertainty* (1 standard
    deviation); the tip expands as the last link. *temperature_range_c*: where they hold.
    """
    constants = constants_of(arm.nominal(), arm.n_joints)
    last = arm.n_joints
    terms = []
    for k, (joint, expansion) in enumerate(zip(arm.joint, expansion_per_k, strict=True), 1):
        lengths = [f"d_{k}", f"a_{k}", *(parameters.TIP_PARAMETERS if k == last else ())]
        for name in lengths if joint.weights else ():
            coefficient = expansion * constants[name]
            if coefficient:
                terms.append(
                    Term(
                        parameter=name,
                        basis=[Temperature(weights=joint.weights)],
                        coefficient=coefficient,
                        standard_uncertainty=abs(coefficient) * relative_uncertainty,
                        effect=f"link_expansion link {k}",
                    )
                )
    deviations = [term.standard_uncertainty or 0.0 for term in terms]
    return Calibration(
        arm=arm.serial_number,
        created=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        reference_temperature_c=arm.reference_temperature_c,
        temperature_range_c=dict.fromkeys(arm.used_sensors, temperature_range_c),
        constants=constants,
        terms=terms,
        covariance_of=[f"term {i}" for i in range(len(terms))],
        covariance=np.diag(np.square(deviations)).tolist(),
        noise=Noise(encoder_rad=_resolution_rad(arm)),
        provenance={
            "method": "known expansion coefficients; nothing was measured on this arm",
            "geometry": "as in arm.toml, its uncertainty not included in the covariance",
            "expansion_per_k": list(expansion_per_k),
        },
    )


def _resolution_rad(arm: Arm) -> list[float]:
    """Standard deviation of a reading rounded to one count; nothing if counts are not known."""
    turns = [joint.counts_per_turn for joint in arm.joint]
    return [math.tau / turn / math.sqrt(12) for turn in turns if turn] if all(turns) else []

"""Model readings with several reflectors: the tip of each is a term of its own.

A reflector's position in the last frame is the tip's offset plus three coefficients. Their basis is
one in its readings and zero in all others. So an unknown reflector is unknown like any term, a
given one is a fixed term, and the estimator needs no code for either. The bases are sensors that
only these observations have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armd.arrays import F64
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.unknowns import INDICATOR
from armd.compensation.model.arm import TemperatureSensor
from armd.compensation.model.parameters import TIP_PARAMETERS
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from armd.errors import BadInput


@dataclass(frozen=True)
class ReflectorTerms:
    """Observations with a sensor for each reflector, and the terms of all reflectors."""

    observations: Observations
    terms: list[Term]
    free: list[int]  # numbers of the unknown terms

    @property
    def hides_tip(self) -> bool:
        """Whether no reading touches with arm.toml's tip itself."""
        return bool(self.terms) and bool((self.observations.reflector >= 0).all())

    def identified(self, constants: Sequence[str]) -> list[str]:
        """Return those of *constants* to identify together with the reflectors.

        Where no reading touches with the tip itself, the tip stays that of arm.toml. Where all
        reflectors are unknown, the last joint's constants move all of them alike, and stay nominal.
        """
        if not self.hides_tip:
            return list(constants)
        names = [name for name in constants if name not in TIP_PARAMETERS]
        if len(self.free) < len(self.terms):
            return names
        layout = self.observations.arm.layout
        last = layout.names[layout.joint(self.observations.arm.n_joints)]
        return [name for name in names if name not in last]


@dataclass(frozen=True)
class FoundReflector:
    """The position of a reflector in the last frame, mm."""

    name: str
    offset_mm: F64  # (3,)
    standard_uncertainty_mm: F64  # (3,), 0 where it was given

    def as_json(self) -> dict[str, Any]:
        return {
            "offset_mm": self.offset_mm.tolist(),
            "standard_uncertainty_mm": self.standard_uncertainty_mm.tolist(),
        }

    def in_words(self) -> str:
        offset = ", ".join(f"{x:.4f}" for x in self.offset_mm)
        uncertain = ", ".join(f"{x:.2g}" for x in self.standard_uncertainty_mm)
        return f"reflector {self.name}: ({offset}) mm in the last frame, ± ({uncertain}) mm"


def make_reflector_terms(observations: Observations, tip_mm: F64) -> ReflectorTerms:
    """Return the observations with the reflectors' terms; *tip_mm* (3,) is the model's tip."""
    if not observations.reflectors:
        return ReflectorTerms(observations, [], [])
    arm, states = observations.arm, observations.states
    names = [INDICATOR + name for name in observations.reflectors]
    sensors = [*arm.temperature_sensor, *(TemperatureSensor(name=name) for name in names)]
    indicators = (observations.reflector[:, None] == np.arange(len(names))).astype(float)
    terms, free = list[Term](), list[int]()
    for name, offset in zip(names, observations.reflectors.values(), strict=True):
        basis = [Temperature(weights={name: 1.0}, reference_c=0.0)]
        for axis, parameter in enumerate(TIP_PARAMETERS):
            offset_from_tip_mm = float(offset[axis] - tip_mm[axis])
            if np.isnan(offset_from_tip_mm):
                free.append(len(terms))
            coefficient = 0.0 if np.isnan(offset_from_tip_mm) else offset_from_tip_mm
            terms.append(Term(parameter=parameter, basis=basis, coefficient=coefficient))
    celsius = np.hstack([states.temperature_c, indicators])
    with_sensors = replace(
        observations,
        arm=arm.model_copy(update={"temperature_sensor": sensors}),
        states=replace(states, temperature_c=celsius),
    )
    return ReflectorTerms(with_sensors, terms, free)


def locate_reflectors(
    observations: Observations,
    constants: F64,
    terms: Sequence[Term],
    names: Sequence[str],
    covariance: F64,
) -> list[FoundReflector]:
    """Return the positions of reflectors, whose terms are the first of a fit's *terms*.

    *names* (C,) are the fit's unknowns, *covariance* (C, C) is their covariance.
    """
    tip = constants[observations.arm.layout.tip]
    columns = {name: i for i, name in enumerate(names)}
    result = []
    for r, reflector in enumerate(observations.reflectors):
        term_numbers = range(3 * r, 3 * r + 3)
        offset = tip + np.array([terms[i].coefficient for i in term_numbers])
        variance = np.zeros(3)
        for axis, i in enumerate(term_numbers):
            if f"term {i}" in columns:  # not given: its covariance with an unknown tip counts, too
                columns_of_axis = [
                    columns[n] for n in (TIP_PARAMETERS[axis], f"term {i}") if n in columns
                ]
                variance[axis] = covariance[np.ix_(columns_of_axis, columns_of_axis)].sum()
        result.append(FoundReflector(reflector, offset, np.sqrt(np.maximum(variance, 0.0))))
    return result


def require_one_kind(tips: ReflectorTerms, files: str) -> None:
    """Raise `BadInput` for reflectors of given offset together with readings of an unknown tip."""
    has_fixed_offset = len(tips.free) < len(tips.terms)
    if has_fixed_offset and not tips.hides_tip:
        description = "readings without a reflector beside a reflector with offset_mm"
        expected = "a reflector in every reading, or no offset_mm: the tip itself is unknown"
        raise BadInput(files, "column reflector", description, expected)


def require_polynomial(method: str, files: str) -> None:
    """Raise `BadInput` for a thermal model that sessions with reflectors cannot have."""
    if method != "polynomial":
        expected = "polynomial: with reflectors no thermal models are compared"
        raise BadInput(files, "--thermal-method", method, expected)

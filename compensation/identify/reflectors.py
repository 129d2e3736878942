"""Readings with several reflectors: the tip of each is a term of its own.

Where a reflector sits in the last frame is the tip's offset plus three coefficients, whose basis is
one in its readings and nothing in all others. So an unknown reflector is unknown as any term is, a
given one is a term that is fixed, and no part of the estimator is told of either. The bases are
sensors that only these observations have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.unknowns import INDICATOR, Unknowns
from armd.compensation.identify.fit import Identification, fit
from armd.compensation.model.arm import TemperatureSensor
from armd.compensation.model.basis import basis_values
from armd.compensation.model.parameters import TIP_PARAMETERS
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from armd.errors import BadInput


@dataclass(frozen=True)
class ReflectorTerms:
    """Observations with a sensor for each reflector, and the terms of all reflectors."""

    observations: Observations
    terms: list[Term]
    free: list[int]  # those of the terms that are unknown

    @property
    def hides_tip(self) -> bool:
        """Whether no reading touches with arm.toml's tip itself."""
        return bool(self.terms) and bool((self.observations.reflector >= 0).all())

    def identified(self, constants: Sequence[str]) -> list[str]:
        """Return those of *constants* to identify beside the reflectors.

        Where no reading touches with the tip itself, it stays arm.toml's. Where all reflectors are
        unknown, the last joint's constants move all of them alike, and stay as drawn.
        """
        if not self.hides_tip:
            return list(constants)
        kept = [name for name in constants if name not in TIP_PARAMETERS]
        if len(self.free) < len(self.terms):
            return kept
        layout = self.observations.arm.layout
        last = layout.names[layout.joint(self.observations.arm.n_joints)]
        return [name for name in kept if name not in last]


@dataclass(frozen=True)
class FoundReflector:
    """Where a reflector sits in the last frame, mm."""

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


def reflector_terms(observations: Observations, tip_mm: F64) -> ReflectorTerms:
    """Return the observations with the reflectors' terms, *tip_mm* (3,) being the model's tip."""
    if not observations.reflectors:
        return ReflectorTerms(observations, [], [])
    arm, states = observations.arm, observations.states
    names = [INDICATOR + name for name in observations.reflectors]
    sensors = [*arm.temperature_sensor, *(TemperatureSensor(name=name) for name in names)]
    own = (observations.reflector[:, None] == np.arange(len(names))).astype(float)
    terms, free = list[Term](), list[int]()
    for name, offset in zip(names, observations.reflectors.values(), strict=True):
        basis = [Temperature(weights={name: 1.0}, reference_c=0.0)]
        for axis, parameter in enumerate(TIP_PARAMETERS):
            given = float(offset[axis] - tip_mm[axis])
            if np.isnan(given):
                free.append(len(terms))
            coefficient = 0.0 if np.isnan(given) else given
            terms.append(Term(parameter=parameter, basis=basis, coefficient=coefficient))
    celsius = np.hstack([states.temperature_c, own])
    known = replace(
        observations,
        arm=arm.model_copy(update={"temperature_sensor": sensors}),
        states=replace(states, temperature_c=celsius),
    )
    return ReflectorTerms(known, terms, free)


def fit_reflectors(
    tips: ReflectorTerms, constants: F64, terms: Sequence[Term], reference_c: float
) -> Identification:
    """Fit where unknown reflectors sit, constants (P,) and *terms* being as they are; readings
    without a temperature that a term needs have no part."""
    every, arm = [*tips.terms, *terms], tips.observations.arm
    basis = basis_values(every, tips.observations.states, arm, reference_c, constants)
    usable: Mask = np.all(np.isfinite(basis), axis=1)
    observations = tips.observations.rows(usable) if usable.any() else tips.observations
    return fit(observations, constants, every, Unknowns((), tips.free), reference_c)


def found_reflectors(found: Identification) -> list[FoundReflector]:
    """Return where the reflectors of a fit sit, whose first terms are theirs."""
    arm = found.observations.arm
    tip = found.constants[arm.layout.tip]
    columns = {name: i for i, name in enumerate(found.unknowns.names)}
    result = []
    for r, name in enumerate(found.observations.reflectors):
        own = range(3 * r, 3 * r + 3)
        offset = tip + np.array([found.terms[i].coefficient for i in own])
        variance = [_variance(found, columns, TIP_PARAMETERS[i - 3 * r], i) for i in own]
        result.append(FoundReflector(name, offset, np.sqrt(np.maximum(variance, 0.0))))
    return result


def _variance(
    found: Identification, columns: Mapping[str, int], parameter: str, term: int
) -> float:
    """Of a parameter and a term together, as far as they were unknown; of a given one 0."""
    if f"term {term}" not in columns:
        return 0.0
    own: Sequence[int] = [columns[n] for n in (parameter, f"term {term}") if n in columns]
    return float(found.covariance[np.ix_(own, own)].sum())


def without_reflectors(found: Identification, count: int) -> Identification:
    """Return a fit without its first *count* terms, which are the reflectors', for a file."""
    if not count:
        return found
    kept = [i for i, name in enumerate(found.unknowns.names) if _number(name) >= count]
    terms = [i - count for i in found.unknowns.terms if i >= count]
    return replace(
        found,
        terms=found.terms[count:],
        unknowns=Unknowns(found.unknowns.constants, terms),
        covariance=found.covariance[np.ix_(kept, kept)],
    )


def _number(name: str) -> float:
    """Of a term among the names of unknowns; of a constant more than any."""
    return float(name.removeprefix("term ")) if name.startswith("term ") else np.inf


def require_one_kind(tips: ReflectorTerms, files: str) -> None:
    """Raise `BadInput` for reflectors whose place is given beside readings of an unknown tip."""
    given = len(tips.free) < len(tips.terms)
    if given and not tips.hides_tip:
        found = "readings without a reflector beside a reflector with offset_mm"
        expected = "a reflector in every reading, or no offset_mm: the tip itself is unknown"
        raise BadInput(files, "column reflector", found, expected)

"""The unknowns of an identification: some constants, and coefficients of some terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.estimate.gauge import PLAUSIBLE
from armd.compensation.model import parameters
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term

#: A term is plausible up to this share of its parameter's plausible departure (rms of its basis).
PLAUSIBLE_TERM = 0.1
#: No drawing gives a reflector's position: it may be so far from the tip.
PLAUSIBLE_REFLECTOR_MM = 100.0
#: Prefix of a reflector's indicator, a sensor that is 1 in its readings and 0 in all others.
INDICATOR = "reflector "


@dataclass(frozen=True)
class Unknowns:
    """The unknowns: some constants by name, some terms by index."""

    constants: Sequence[str]
    terms: Sequence[int] = ()

    @property
    def names(self) -> list[str]:
        """The names as in `covariance_of` of a calibration: constants, then "term I"."""
        return [*self.constants, *(f"term {i}" for i in self.terms)]

    def words(self, terms: Sequence[Term]) -> list[str]:
        """Return the names for a person to read: a term by its parameter and basis."""
        return [*self.constants, *(describe_term(terms[i]) for i in self.terms)]

    def values(self, constants: F64, terms: Sequence[Term]) -> F64:
        """Return the values (C,) of the unknowns in constants (P,) and terms."""
        coefficients = [terms[i].coefficient for i in self.terms]
        return np.concatenate([constants[self._indices(constants)], coefficients])

    def put(self, x: F64, constants: F64, terms: Sequence[Term]) -> tuple[F64, list[Term]]:
        """Return constants and terms with the values (C,) of the unknowns inserted."""
        constants, terms = constants.copy(), list(terms)
        indices = self._indices(constants)
        constants[indices] = x[: len(indices)]
        for i, coefficient in zip(self.terms, x[len(indices) :], strict=True):
            terms[i] = terms[i].model_copy(update={"coefficient": float(coefficient)})
        return constants, terms

    def columns(self, jacobian: F64, basis: F64, terms: Sequence[Term]) -> F64:
        """Return d tip / d unknown (n, 3, C), from d tip / d parameter and basis values.

        These are (n, 3, P) and (n, T). Zero for θ₁ and d₁: moving the whole arm about its first
        axis moves every placement alike.
        """
        layout = ParameterLayout.from_count(jacobian.shape[2])
        names = [*self.constants, *(terms[i].parameter for i in self.terms)]
        # Row by row in memory, as readings are accessed; an index would put columns first.
        columns: F64 = np.take(jacobian, np.array(layout.indices(names), dtype=np.int64), axis=2)
        columns[:, :, len(self.constants) :] *= basis[:, None, list(self.terms)]
        is_placing = [name in ("theta_1", "d_1") for name in self.constants]
        columns[:, :, np.flatnonzero(is_placing)] = 0.0
        return columns

    def get_plausible(self, terms: Sequence[Term], basis: F64) -> F64:
        """Return plausible departures (C,) in each unknown's own unit."""
        sizes = [PLAUSIBLE[parameters.find_unit(name)] for name in self.constants]
        for i in self.terms:
            typical = float(np.sqrt(np.mean(basis[:, i] ** 2)))
            unit = PLAUSIBLE[parameters.find_unit(terms[i].parameter)]
            if is_of_reflector(terms[i]):
                sizes.append(PLAUSIBLE_REFLECTOR_MM)
                continue
            sizes.append(PLAUSIBLE_TERM * unit / max(typical, 1e-12))
        return np.array(sizes)

    def _indices(self, constants: F64) -> list[int]:
        return ParameterLayout.from_count(len(constants)).indices(self.constants)


def is_indicator(sensor: str) -> bool:
    """Return whether a sensor is the indicator of a reflector's readings."""
    return sensor.startswith(INDICATOR)


def is_of_reflector(term: Term) -> bool:
    """Return whether a term is the position of a reflector."""
    factors = (f for f in term.basis if isinstance(f, Temperature))
    return any(is_indicator(sensor) for factor in factors for sensor in factor.weights)


def describe_term(term: Term) -> str:
    """Describe a term for a person: d_2·ΔT²(t2), or tip_x of reflector A."""
    if is_of_reflector(term):
        sensors = (s for f in term.basis if isinstance(f, Temperature) for s in f.weights)
        return f"{term.parameter} of {next(sensors)}"
    factors = []
    for factor in term.basis:
        if isinstance(factor, Temperature):
            power = "⁰¹²³⁴"[factor.order] if factor.order > 1 else ""
            zone = f", {factor.zone_c[0]:.0f}…{factor.zone_c[1]:.0f} °C" if factor.zone_c else ""
            factors.append(f"ΔT{power}({'+'.join(factor.weights)}{zone})")
        else:
            joint = getattr(factor, "joint", getattr(factor, "link", ""))
            factors.append(f"{factor.kind}({joint})")
    return "·".join([term.parameter, *factors])

"""Judge the nominal geometry of arm.toml: its misses, and where the fitted arm is far off it.

No drawing knows the offset of a tip or of a tracker's reflector, or the poses of base and
artefacts. These are fitted first; the remaining miss is the nominal geometry's own error. The
encoders' zeros are not fitted, because a calibration exists to find them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from armd.arrays import F64
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import Identification, compute_fit_gauge, compute_rms_um, fit
from armd.compensation.model import parameters
from armd.compensation.model.parameters import TIP_PARAMETERS
from armd.compensation.model.terms import Term

#: A parameter is reported if it is farther off than this, in the unit that people read. Parts are
#: made to tenths of a millimetre and of a degree, printed ones to a few tenths. So a larger
#: difference is a typing error, a forgotten part, or a joint that nobody homed.
FAR = {"mm": 5.0, "°": 1.0}
#: The difference must also exceed this many standard uncertainties. What the readings leave open
#: has the uncertainty of a plausible departure.
SURE = 3.0
#: Where readings cannot separate them, the tip departs this many times more easily than a link,
#: because no drawing knows the tip.
TIP_EASE = 1e3
#: The iterations of reweighted least squares that find the solution with the fewest parameters off,
#: and the departure, in plausible departures, that counts as none.
ROUNDS, NO_DEPARTURE = 20, 1e-3


@dataclass(frozen=True)
class OffNominal:
    """One parameter far off arm.toml; mm or degrees."""

    parameter: str
    place: str  # "joint 2", "zero of joint 2's encoder", or "tip"
    drawing: float
    fitted: float
    standard_uncertainty: float
    unit: str

    @property
    def difference(self) -> float:
        return self.fitted - self.drawing

    def as_json(self) -> dict[str, Any]:
        return {**asdict(self), "difference": self.difference}

    def in_brief(self) -> str:
        """Return words such as `a_2 +60.02 mm (joint 2)`."""
        return f"{self.parameter} {self.difference:+.2f}{self._unit} ({self.place})"

    def in_words(self) -> str:
        return (
            f"arm.toml may be wrong: {self.parameter} ({self.place}) is"
            f" {self.drawing:.2f}{self._unit} there and {self.fitted:.2f}{self._unit} as fitted,"
            f" {self.difference:+.2f}{self._unit} with a standard uncertainty of"
            f" {self.standard_uncertainty:.2g}{self._unit}; {self._advice}"
        )

    @property
    def _unit(self) -> str:
        return self.unit if self.unit == "°" else f" {self.unit}"

    @property
    def _advice(self) -> str:
        if self.place == "tip":
            return "was another tip or reflector used?"
        if self.place.startswith("zero"):
            return f"was the joint homed? {self.parameter} is no part of a drawing"
        return "compare it with the drawing"


def compute_nominal_rms_um(
    observations: Observations, terms: Sequence[Term] = (), free: Sequence[int] = ()
) -> float:
    """Compute the 3-D RMS of readings under the nominal links, with the best tip.

    The *free* ones of the reflectors' *terms* are fitted, too.
    """
    arm = observations.arm
    reference_c = arm.reference_temperature_c
    as_drawn = evaluate_model(observations, arm.nominal(), terms, reference_c)
    tip = fit(observations, arm.nominal(), terms, Unknowns(TIP_PARAMETERS, free), reference_c)
    fitted = evaluate_model(observations, tip.constants, tip.terms, reference_c)
    return min(compute_rms_um(as_drawn.residual_mm), compute_rms_um(fitted.residual_mm))


def find_off_nominal(identification: Identification) -> list[OffNominal]:
    """Find the lengths and angles that are significantly far off the nominal ones.

    Where the readings cannot separate parameters, the tip departs rather than a link, and few
    parameters rather than many. θ₁ and d₁ only place the arm and are skipped.
    """
    arm, count = identification.observations.arm, len(identification.unknowns.constants)
    names, scale = list(identification.unknowns.constants), identification.solution.scale[:count]
    nominal_values = arm.nominal()[arm.layout.indices(names)]
    undecided = identification.solution.null[:count]
    ease = np.array([1.0 / TIP_EASE if name in TIP_PARAMETERS else 1.0 for name in names])
    departure, weight = _find_sparsest(identification.departure[:count] / scale, undecided, ease)
    # A direction that moves no point is a choice and not uncertain; all else unknown is uncertain.
    choice = compute_fit_gauge(
        identification.unknowns,
        identification.constants,
        identification.terms,
        identification.linearisation.basis,
        identification.solution.scale,
    )[:count]
    chosen = scale[:, None] * _project_out(choice, weight) / scale
    variance = np.diag(chosen @ identification.covariance[:count, :count] @ chosen.T)
    uncertainty = np.sqrt(np.maximum(variance, 0.0))
    entries = []
    for name, nominal, off, u in zip(
        names, nominal_values, departure * scale, uncertainty, strict=True
    ):
        unit, factor = (
            ("mm", 1.0) if parameters.find_unit(name) == "mm" else ("°", float(np.degrees(1.0)))
        )
        is_known = abs(off) > SURE * u
        if name in ("theta_1", "d_1") or not is_known or factor * abs(off) < FAR[unit]:
            continue
        drawn, fitted, u = (factor * float(value) for value in (nominal, nominal + off, u))
        entries.append(OffNominal(name, _name_place(name), drawn, fitted, u, unit))
    return entries


def _name_place(name: str) -> str:
    kind, _, joint = name.rpartition("_")
    if name in TIP_PARAMETERS:
        return "tip"
    return f"zero of joint {joint}'s encoder" if kind == "theta" else f"joint {joint}"


def _find_sparsest(departure: F64, undecided: F64, ease: F64) -> tuple[F64, F64]:
    """Move *departure* (C,) along *undecided* (C, k) until few entries are left.

    Return it with the weights (C,) used; entries with little *ease* (C,) may be large.
    """
    weight = ease / np.sqrt(np.abs(departure) + NO_DEPARTURE)
    moved = departure
    for _ in range(ROUNDS):
        moved = _project_out(undecided, weight) @ departure
        weight = ease / np.sqrt(np.abs(moved) + NO_DEPARTURE)
    return moved, weight


def _project_out(directions: F64, weight: F64) -> F64:
    """Return the projection (C, C) along *directions* (C, k) that minimises the weighted square."""
    along: F64 = np.linalg.pinv(weight[:, None] * directions) * weight
    return np.eye(len(weight)) - directions @ along

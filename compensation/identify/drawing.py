"""The drawing of arm.toml judged: what it misses by, and where the fitted arm is far off it.

No drawing knows where a tip or a tracker's reflector sits, where the base and the artefacts stand.
That is fitted first. What then remains is the drawing's own error.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from armd.arrays import F64
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import Identification, fit, rms_um
from armd.compensation.model import parameters
from armd.compensation.model.parameters import TIP_PARAMETERS

#: No maker's drawing is so far off its arm; a typing error or a forgotten part is.
FAR_MM, FAR_DEG = 5.0, 1.0
#: What is off must also be known: by this many standard uncertainties.
SURE = 3.0
#: What no drawing knows may depart from it so much more easily: it takes what directions that the
#: readings cannot tell apart leave open.
FREE = 1e3
#: Rounds that find the direction with the fewest parameters off (reweighted least squares), and
#: where a departure, in plausible ones, counts as none.
ROUNDS, NONE = 20, 1e-3


@dataclass(frozen=True)
class OffDrawing:
    """One parameter far off the drawing; mm or degrees."""

    parameter: str
    place: str  # "joint 2", or "tip"
    drawing: float
    fitted: float
    standard_uncertainty: float
    unit: str

    @property
    def difference(self) -> float:
        return self.fitted - self.drawing

    def as_json(self) -> dict[str, Any]:
        return {**asdict(self), "difference": self.difference}

    def in_words(self) -> str:
        digits = 3 if self.unit == "mm" else 4
        words = (
            f"arm.toml may be wrong: {self.parameter} ({self.place}) is"
            f" {self.drawing:.{digits}f} {self.unit} in the drawing and"
            f" {self.fitted:.{digits}f} {self.unit} as fitted: {self.difference:+.{digits}f}"
            f" {self.unit}, standard uncertainty {self.standard_uncertainty:.2g} {self.unit}"
        )
        if self.place == "tip":
            words += " (another tip or reflector than arm.toml has?)"
        return words


def drawn_rms_um(observations: Observations) -> float:
    """3-D RMS of readings under the drawing's links, with the one tip that suits them best."""
    arm = observations.arm
    reference_c = arm.reference_temperature_c
    as_drawn = evaluate_model(observations, arm.nominal(), [], reference_c)
    tip = fit(observations, arm.nominal(), [], Unknowns(TIP_PARAMETERS), reference_c)
    fitted = evaluate_model(observations, tip.constants, [], reference_c)
    return min(rms_um(as_drawn.residual_mm), rms_um(fitted.residual_mm))


def off_drawing(found: Identification) -> list[OffDrawing]:
    """The lengths and angles that are far off the drawing, whatever the readings leave open.

    Where the readings cannot tell parameters apart, the tip departs rather than a link, and few
    parameters rather than many. θ₁ and d₁ only place the arm, and have no part.
    """
    arm, count = found.observations.arm, len(found.unknowns.constants)
    names, scale = list(found.unknowns.constants), found.solution.scale[:count]
    drawing = arm.nominal()[arm.layout.indices(names)]
    undecided = found.solution.null[:count]
    in_plausible = found.departure[:count] / scale
    gauge = _sparsest(in_plausible, undecided, names)
    departure = gauge @ in_plausible * scale
    known = found.solution.known_covariance()[:count, :count] * found.variance_factor
    to_units = scale[:, None] * gauge / scale
    deviation = np.sqrt(np.maximum(np.diag(to_units @ known @ to_units.T), 0.0))
    far = []
    for name, nominal, off, u in zip(names, drawing, departure, deviation, strict=True):
        if name in ("theta_1", "d_1"):
            continue
        length = parameters.unit(name) == "mm"
        factor = 1.0 if length else float(np.degrees(1.0))
        if abs(factor * off) < (FAR_MM if length else FAR_DEG) or abs(off) < SURE * u:
            continue
        place = "tip" if name in TIP_PARAMETERS else f"joint {name.rpartition('_')[2]}"
        far.append(
            OffDrawing(
                name, place, factor * float(nominal), factor * float(nominal + off),
                factor * float(u), "mm" if length else "°",
            )
        )  # fmt: skip
    return far


def _sparsest(departure: F64, undecided: F64, names: list[str]) -> F64:
    """(C, C) that moves *departure* (C,) along *undecided* (C, k) to have few entries.

    It carries the covariance of what is known likewise, whichever gauge that was stated in.
    """
    still: F64 = np.eye(len(departure))
    if not undecided.shape[1]:
        return still
    weight = np.array([1.0 / FREE if name in TIP_PARAMETERS else 1.0 for name in names])
    each, gauge = weight, still
    for _ in range(ROUNDS):
        gauge = still - undecided @ np.linalg.pinv(each[:, None] * undecided) * each
        each = weight / np.sqrt(np.abs(gauge @ departure) + NONE)
    return gauge

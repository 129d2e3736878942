"""A calibration, and what a report states about its origin."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from armd.compensation.identify.admission.inconsistent_session import InconsistentSession
from armd.compensation.identify.admission.second_group import SecondGroup
from armd.compensation.identify.certificate import Certificate
from armd.compensation.identify.drawing import OffNominal
from armd.compensation.identify.evaluation.lengths import Length
from armd.compensation.identify.fit import Identification
from armd.compensation.identify.heldout import (
    Errors,
    compute_another_placement_um,
    describe_held_out,
)
from armd.compensation.identify.orientation import OrientationGain
from armd.compensation.identify.reflectors import FoundReflector
from armd.compensation.identify.thermal.comparison import Trial
from armd.compensation.model.calibration import Calibration


@dataclass(frozen=True, kw_only=True)
class Result:
    """A calibration, and what a report states about its origin."""

    calibration: Calibration
    fit: Identification
    rms_um: float  # 3-D RMS of all readings at their best placements, as in `armd evaluate`
    heldout: Errors
    heldout_by: str  # "placement", "reading" or "temperature"
    thermal_order: int
    thermal_method: str
    trials: list[Trial]
    unidentifiable: list[str]
    certificate: Certificate
    lengths: list[Length]  # certified, with those that the calibrated arm measures
    inconsistent_session: InconsistentSession | None  # the session that does not fit the others
    off_drawing: list[OffNominal]  # parameters far off arm.toml's
    notes: list[str] = field(default_factory=list)
    second_group: SecondGroup | None = None  # rows of another tip or place
    orientation: OrientationGain | None = None  # what orientations added
    reflectors: list[FoundReflector] = field(default_factory=list)

    @property
    def heldout_rms_um(self) -> float:
        """The 3-D RMS of all readings, held out in turn."""
        return self.heldout.rms_um

    @property
    def another_placement_um(self) -> float | None:
        """The 3-D RMS that another placement stays below in 95 of 100 cases, if few were measured.

        None where many were measured.
        """
        return compute_another_placement_um(self.fit.observations, self.heldout, self.heldout_by)

    @property
    def held_out_in_words(self) -> str:
        """The content of one held-out set, such as `every 8th reading`."""
        return describe_held_out(self.fit.observations, self.heldout, self.heldout_by)

    def as_json(self) -> dict[str, Any]:
        """Return the object that `armd calibrate --json` writes."""
        observations = self.fit.observations
        ranges = list(self.calibration.temperature_range_c.values())
        return {
            "rms_um": self.rms_um,
            "heldout_rms_um": self.heldout_rms_um,
            "heldout_by": self.heldout_by,
            "heldout_without_outliers_um": self.heldout.without_down_weighted_um,
            "heldout_of_sets_um": list(self.heldout.of_sets_um),
            "another_placement_um": self.another_placement_um,
            "certificate": asdict(self.certificate),
            "lengths": [length.as_json() for length in self.lengths],
            "off_drawing": [item.as_json() for item in self.off_drawing],
            "rank": self.fit.solution.rank,
            "unknowns": len(self.fit.unknowns.names),
            "unidentifiable": self.unidentifiable,
            "thermal_order": self.thermal_order,
            "thermal_method": self.thermal_method,
            "temperature_range_c": (
                [min(low for low, _ in ranges), max(high for _, high in ranges)] if ranges else []
            ),
            "n": observations.n,
            "placements": len(np.unique(observations.placement)),
            "noise": self.calibration.noise.model_dump(),
            "outliers": self.outliers(),
            "thermal_trials": [
                {"model": trial.name, "heldout_rms_um": trial.heldout_rms_um}
                for trial in self.trials
            ],
            "second_group": self.second_group.as_json() if self.second_group else None,
            "orientation": self.orientation.as_json() if self.orientation else None,
            "reflectors": {item.name: item.as_json() for item in self.reflectors},
            "steps": self.fit.steps,
            "converged": self.fit.converged,
            "notes": self.notes,
        }

    def outliers(self) -> list[dict[str, Any]]:
        """List the outliers by session and row (counted from 1)."""
        observations = self.fit.observations
        return [
            {
                "session": observations.session_names[observations.session[i]],
                "row": int(observations.row[i]) + 1,
                "error_um": 1e3 * float(np.linalg.norm(self.fit.linearisation.residual_mm[i])),
                "sigma": float(np.sqrt(self.fit.distance2[i])),
            }
            for i in self.fit.outliers
        ]

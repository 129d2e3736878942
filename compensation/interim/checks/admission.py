"""The admission of checks: an impossible check is refused, because a history removes nothing.

A check that is bad in some other way is kept and judged: the neighbouring checks show whether the
arm changed or the check is bad.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import F64
from armd.compensation.data.sessions.points_only import require_points
from armd.compensation.data.sessions.session import Session
from armd.compensation.data.soundness.soundness import find_still_and_far
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.identify.admission.far_off import (
    list_without_temperature,
    measure_distances_mm,
)
from armd.compensation.identify.admission.inconsistent_session import (
    ABSURD_MM,
    find_mistake,
    refuse_mistakes,
)
from armd.compensation.identify.admission.mistakes import LEAST_FAHRENHEIT, AssumedModel
from armd.compensation.identify.admission.wrong_names import refuse_misnamed
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.errors import BadInput


def refuse_unfit(sessions: Sequence[Session], arm: Arm, calibration: Calibration) -> list[str]:
    """Raise `BadInput` for the first of *sessions* that is no check of this calibrated arm.

    Reasons are wrong units, columns or names, impossible temperatures, and readings of another arm
    or artefact. Returns remarks on the sessions that are admitted.
    """
    require_points(sessions, "`armd interim`")
    model = AssumedModel.from_calibration(arm, calibration)
    remarks: list[str] = []
    for session in sessions:
        observations = collect_observations([session], arm, calibration.artefact)
        _refuse_temperatures(session, observations, model)
        refuse_mistakes([session], observations, model)
        refuse_misnamed([session], observations, model)
        position = model.tip_mm(observations)
        _refuse_absurd(session, measure_distances_mm(observations, position))
        remarks += session.remarks
        remarks += list_without_temperature(session, np.isfinite(position[:, 0]))
    return remarks


def _refuse_temperatures(session: Session, observations: Observations, model: AssumedModel) -> None:
    celsius = observations.states.temperature_c
    if np.nanmin(celsius, initial=np.inf) > LEAST_FAHRENHEIT:
        # Hot servos exceed this limit, too: refuse only if °F explain the residuals.
        fault = find_mistake(session, observations, model, "under the calibration given")
        if fault is not None:
            raise fault
    if still := find_still_and_far(session, observations.arm):
        still_channels = ", ".join(f"{name} {celsius:g} °C in every row" for name, celsius in still)
        expected = "temperatures of one room: a channel that shows nothing is left empty"
        raise BadInput(session.path, "temperatures", still_channels, expected)


def _refuse_absurd(session: Session, off_mm: F64) -> None:
    """Raise `BadInput` if half of the readings are centimetres off.

    A calibrated arm errs by micrometres, so this is another arm or another artefact.
    """
    finite_mm = off_mm[np.isfinite(off_mm)]
    if len(finite_mm) and np.median(finite_mm) > ABSURD_MM:
        raise BadInput(
            session.path,
            "the readings",
            f"half of them more than {np.median(finite_mm):.0f} mm from where the others place"
            " them",
            "readings of this arm on this artefact (names of targets, angle_unit, columns,"
            " directions)",
        )

"""Compare sessions for `armd check`, where each is right by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from armd.compensation.data.sessions.session import Session
from armd.compensation.estimate.observations import Observations
from armd.compensation.identify.admission.far_off import find_far_readings, measure_distances_mm
from armd.compensation.identify.admission.find_second_group import find_second_group
from armd.compensation.identify.admission.inconsistent_session import (
    ABSURD_MM,
    LEAST_SESSIONS,
    find_inconsistent_session,
    identify_rows,
    raise_all,
    refuse_mistakes,
)
from armd.compensation.identify.admission.mistakes import AssumedModel
from armd.compensation.identify.admission.touched_surfaces import require_surfaces
from armd.compensation.identify.admission.wrong_names import refuse_misnamed
from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import compute_rms_um


def compare_sessions(sessions: Sequence[Session], observations: Observations) -> str:
    """Compare several sessions, and describe an inconsistent one and readings far off all others.

    Return an empty string if there is nothing to report. Raises `BadInput` where a mistake is
    plain.
    """
    with threadpool_limits(limits=1, user_api="blas"):  # small matrices: threads only cost
        return _compare(sessions, observations)


def _compare(sessions: Sequence[Session], observations: Observations) -> str:
    arm = observations.arm
    drawn = evaluate_model(observations, arm.nominal(), [], arm.reference_temperature_c)
    require_surfaces(sessions, drawn.observations, drawn.poses, drawn.position_mm)
    if observations.reflectors:  # the tip of each reading is not known
        return ""
    refuse_mistakes(sessions, observations)
    refuse_misnamed(sessions, observations, AssumedModel.from_calibration(observations.arm, None))
    everything = np.ones(observations.n, dtype=bool)
    identification = identify_rows(observations, everything)
    if identification is None:
        return "\n".join(_list_far_readings(sessions, observations))
    if len(sessions) < LEAST_SESSIONS:
        second = find_second_group(sessions, identification)
        raise_all(second.faults() if second else [])
        words = [second.in_words()] if second else []
        return "\n".join([*_list_far_readings(sessions, observations), *words])
    refuse_misnamed(sessions, observations, AssumedModel.from_identification(identification))
    inconsistent = find_inconsistent_session(
        sessions, identification, compute_rms_um(drawn.residual_mm)
    )
    second = (
        None if inconsistent and inconsistent.tip else find_second_group(sessions, identification)
    )
    if second:
        raise_all(second.faults())
        return second.in_words()
    far_words = (
        f"far off (in the air?): {identification.outlier_words()}"
        if len(identification.outliers)
        else ""
    )
    return "\n".join(filter(None, [far_words, inconsistent.in_words() if inconsistent else ""]))


def _list_far_readings(sessions: Sequence[Session], observations: Observations) -> list[str]:
    """List single readings far off under the nominal geometry: no fault of a file, but worth a
    look.
    """
    lines, model = [], AssumedModel.from_calibration(observations.arm, None)
    for k, session in enumerate(sessions):
        part = observations.rows(observations.session == k)
        far_readings = find_far_readings(measure_distances_mm(part, model.tip_mm(part)))
        if far_readings.usual_mm < ABSURD_MM:  # else most readings are far off
            lines += [f"far off (in the air?): {line}" for line in far_readings.in_words(session)]
    return lines

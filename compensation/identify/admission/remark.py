"""What `armd check` says of sessions that are each right by themselves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from armd.compensation.data.session import Session
from armd.compensation.estimate.observations import Observations
from armd.compensation.identify.admission.far_off import distances_mm, far_off
from armd.compensation.identify.admission.find_second_group import find_second_group
from armd.compensation.identify.admission.mistakes import AssumedModel
from armd.compensation.identify.admission.odd_session import (
    ABSURD_MM,
    LEAST_SESSIONS,
    identified,
    odd_session,
    raise_all,
    refuse_mistakes,
)
from armd.compensation.identify.admission.touched_surfaces import require_surfaces
from armd.compensation.identify.admission.wrong_names import refuse_misnamed
from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import rms_um


def remark(sessions: Sequence[Session], observations: Observations) -> str:
    """What several sessions, held against each other, say of one of them, and which readings of
    any are far off all others; empty if nothing.

    Raises `BadInput` where it is plain what is wrong.
    """
    with threadpool_limits(limits=1, user_api="blas"):  # small matrices: threads only cost
        return _remark(sessions, observations)


def _remark(sessions: Sequence[Session], observations: Observations) -> str:
    arm = observations.arm
    drawn = evaluate_model(observations, arm.nominal(), [], arm.reference_temperature_c)
    require_surfaces(sessions, drawn.observations, drawn.poses, drawn.position_mm)
    if observations.reflectors:  # nobody knows where each reading's tip is
        return ""
    refuse_mistakes(sessions, observations)
    refuse_misnamed(sessions, observations, AssumedModel.under(observations.arm, None))
    everything = np.ones(observations.n, dtype=bool)
    found = identified(observations, everything)
    if found is None:
        return "\n".join(_far_off(sessions, observations))
    if len(sessions) < LEAST_SESSIONS:
        second = find_second_group(sessions, found)
        raise_all(second.faults() if second else [])
        words = [second.in_words()] if second else []
        return "\n".join([*_far_off(sessions, observations), *words])
    refuse_misnamed(sessions, observations, AssumedModel.of(found))
    odd = odd_session(sessions, found, rms_um(drawn.residual_mm))
    second = None if odd and odd.tip else find_second_group(sessions, found)
    if second:
        raise_all(second.faults())
        return second.in_words()
    far = f"far off (in the air?): {found.outlier_words()}" if len(found.outliers) else ""
    return "\n".join(filter(None, [far, odd.in_words() if odd else ""]))


def _far_off(sessions: Sequence[Session], observations: Observations) -> list[str]:
    """Single readings far off under the drawing: no fault of a file, and somebody should know."""
    lines, model = [], AssumedModel.under(observations.arm, None)
    for k, session in enumerate(sessions):
        part = observations.rows(observations.session == k)
        found = far_off(distances_mm(part, model.tip_mm(part)))
        if found.usual_mm < ABSURD_MM:  # where most are, no reading is single
            lines += [f"far off (in the air?): {line}" for line in found.in_words(session)]
    return lines

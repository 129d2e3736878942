"""Find readings under another target's name: one target was touched and another was written down.

`mistakes` finds a whole session that exchanges two names. Here a few readings miss their own target
by a multiple of the usual miss. They lie at another target as closely as other readings at theirs.
A reading that lies at no target is an outlier and is not reported here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from armd.arrays import F64, I64
from armd.compensation.data.sessions.files import find_readings
from armd.compensation.data.sessions.session import Session
from armd.compensation.data.tables.readings import describe_row
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.placements.fit_poses import fit_robust_poses
from armd.compensation.estimate.surface_kinds import POINT
from armd.compensation.identify.admission.inconsistent_session import raise_all
from armd.compensation.identify.admission.mistakes import (
    LEAST_MISS_MM,
    LEAST_READINGS,
    AssumedModel,
)
from armd.errors import BadInput
from armd.terminal.counted import format_count

#: The misses are skewed: under the nominal geometry one reading in a hundred misses by three to
#: four medians. In medians, a reading farther than FAR is not at its target, and one within NEAR
#: is.
FAR, NEAR = 12.0, 4.0
#: The most rows that a message lists.
MOST_TOLD = 6


@dataclass(frozen=True)
class WrongNames:
    """The m readings with a wrong name, by their index, and the targets at which they lie."""

    reading: I64  # (m,)
    touched: I64  # (m,) targets
    own_mm: F64  # (m,) distance from the target that the reading names
    at_mm: F64  # (m,) distance from the target at which it lies


def find_wrong_names(observations: Observations, model: AssumedModel) -> WrongNames:
    """Find the readings of one session that, under *model*, lie at another target than they name.

    Readings with a truth of their own, those on surfaces, and those without a temperature that
    *model* needs are skipped.
    """
    position = model.tip_mm(observations)
    pointed = ~observations.has_truth & ~observations.on_surface
    judged_rows = np.flatnonzero(np.isfinite(position[:, 0]) & pointed)
    if not len(judged_rows):
        return WrongNames(judged_rows, judged_rows, np.empty(0), np.empty(0))
    observations, position = observations.rows(judged_rows), position[judged_rows]
    poses, own_mm = fit_robust_poses(observations, position, roughly=True)
    level = max(float(np.median(own_mm)), LEAST_MISS_MM)
    # Where hardly any reading lies at its target, the artefact's pose is not known.
    n_near = np.bincount(
        observations.placement[own_mm < NEAR * level], minlength=len(observations.placement_names)
    )
    far_rows = np.flatnonzero(
        (own_mm > FAR * level) & (n_near[observations.placement] >= LEAST_READINGS)
    )
    touched = np.isin(np.arange(len(observations.unknown)), observations.target)
    session = np.isin(observations.target_session, observations.session)
    is_placed = touched | ~observations.unknown
    candidates = np.flatnonzero(session & is_placed & (observations.kind == POINT))
    positions_mm = poses.place_at(observations.rows(far_rows), candidates)
    distance = np.linalg.norm(position[far_rows, None] - positions_mm, axis=2)
    nearest = distance.argmin(axis=1)
    at_mm = distance[np.arange(len(far_rows)), nearest]
    elsewhere = (candidates[nearest] != observations.target[far_rows]) & (at_mm < NEAR * level)
    far_rows = far_rows[elsewhere]
    return WrongNames(
        judged_rows[far_rows], candidates[nearest][elsewhere], own_mm[far_rows], at_mm[elsewhere]
    )


def list_misnamed(
    sessions: Sequence[Session], observations: Observations, model: AssumedModel
) -> list[BadInput]:
    """List a fault for each of *sessions* with readings at another target than they name.

    *observations* are of *sessions*; some rows may be missing.
    """
    with threadpool_limits(limits=1, user_api="blas"):  # small matrices: threads only cost
        return _list_misnamed(sessions, observations, model)


def _list_misnamed(
    sessions: Sequence[Session], observations: Observations, model: AssumedModel
) -> list[BadInput]:
    faults = []
    for k, session in enumerate(sessions):
        part = observations.rows(observations.session == k)
        misnamed_readings = find_wrong_names(part, model)
        if len(misnamed_readings.reading):
            faults.append(_make_fault(session, part, misnamed_readings))
    return faults


def refuse_misnamed(
    sessions: Sequence[Session], observations: Observations, model: AssumedModel
) -> None:
    """Raise `BadInput` for readings of *sessions* that lie at another target than they name."""
    raise_all(list_misnamed(sessions, observations, model))


def report_misnamed(
    sessions: Sequence[Session], observations: Observations, model: AssumedModel
) -> list[str]:
    """Report misnamed readings in words, where they are outliers among many right ones."""
    return [
        f"{Path(fault.file).parent.name}: {fault.found}"
        for fault in list_misnamed(sessions, observations, model)
    ]


def _make_fault(session: Session, part: Observations, misnamed_readings: WrongNames) -> BadInput:
    names = [name.partition("/")[2] for name in part.target_names]
    path = find_readings(session.path)
    words = []
    for i, target, own_mm, at_mm in zip(
        misnamed_readings.reading,
        misnamed_readings.touched,
        misnamed_readings.own_mm,
        misnamed_readings.at_mm,
        strict=True,
    ):
        row_words = describe_row(path, int(part.row[i]))
        words.append(
            f"{row_words} names {names[part.target[i]]}, {own_mm:.3g} mm off, and lies at"
            f" {names[target]}, {at_mm:.2g} mm off"
        )
    tail = f"; and {len(words) - MOST_TOLD} more" if len(words) > MOST_TOLD else ""
    return BadInput(
        path,
        "column target",
        f"{format_count(len(words), 'reading')} of another target: "
        f"{'; '.join(words[:MOST_TOLD])}{tail}",
        "each reading under the name of the target it touched",
    )

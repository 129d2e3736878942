"""The averaged readings, one row per rest; a 6-D reading has a second row for its orientation.

Readings taken one after another at one rest are not independent; they enter as their mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.constants import BLOCKS, MOST_FOLDS, REST_RAD
from armd.compensation.diagnose.problem.linear import Rests
from armd.compensation.estimate.folds import assign_group_folds, assign_posture_folds
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.estimate.orientations import add_orientations, find_oriented_rows
from armd.compensation.identify.admission.requirements import count_artefact_unknowns
from armd.compensation.model.arm import Arm
from armd.compensation.model.state import States
from armd.errors import BadInput

#: The label that orientations have in place of a target's.
ORIENTATION = "orientation"


def collect_rests(sessions: Sequence[Session], arm: Arm) -> Rests:
    """Join sessions and average the readings of each rest; orientations follow all points.

    A surface has no orientation of its own to compare with. Where there are surfaces, orientations
    are not used.
    """
    raw = collect_observations(sessions, arm)
    rise = np.concatenate([session.artefact_rise_k for session in sessions])
    used = _complete(raw, arm)
    raw, rise = raw.rows(used), rise[used]
    rest_of = _rests(raw)
    first = np.unique(rest_of, return_index=True)[1]
    rest_of_reading = np.full(len(used), -1, dtype=np.int64)
    rest_of_reading[used] = rest_of
    states = raw.states

    def mean(values: F64) -> F64:
        if values.size == 0:  # no sensors
            return values[first]
        flat = values.reshape(len(values), -1)
        sums = np.stack([np.bincount(rest_of, column) for column in flat.T], axis=1)
        average: F64 = (sums / np.bincount(rest_of)[:, None]).reshape(-1, *values.shape[1:])
        return average

    observations = replace(
        raw,
        states=States(
            q=mean(states.q),
            rate=mean(states.rate),
            temperature_c=mean(states.temperature_c),
            time_s=mean(states.time_s),
            approach=states.approach[first],
            series=states.series[first],
        ),
        session=raw.session[first],
        placement=raw.placement[first],
        target=raw.target[first],
        truth_mm=mean(raw.truth_mm),
        stretch=mean(raw.stretch),
        reflector=raw.reflector[first],
        measured_turn=_mean_turns(mean(raw.measured_turn)),
        turned=raw.turned[first],
    )
    labels = [name for s in sessions for name in s.artefact.target_names]
    point_of = np.arange(observations.n)
    if not observations.on_surface.any():
        point_of = np.append(point_of, find_oriented_rows(observations))
        observations = add_orientations(observations)
    labels += [ORIENTATION] * (len(observations.target_names) - len(labels))
    return Rests(
        tuple(sessions),
        observations,
        mean(rise)[point_of],
        rest_of_reading,
        np.flatnonzero(used)[first][point_of],
        tuple(labels),
        point_of,
    )


def _mean_turns(mean: F64) -> F64:
    """Return the rotations (n, 3, 3) nearest to mean matrices; NaN where there is none."""
    finite = np.isfinite(mean[:, 0, 0])
    turns = mean.copy()
    if finite.any():
        u, _, v = np.linalg.svd(mean[finite])
        turns[finite] = u @ v
    return turns


def count_spare_rows(observations: Observations) -> int:
    """Count the numbers measured beyond those that placements and unknown seats absorb."""
    seats = np.unique(observations.target[~observations.has_truth])
    seats = seats[observations.unknown[seats]]
    touched = np.isin(observations.distances.between, seats).all(axis=1)
    used = np.unique(observations.reflector)
    offsets = [o for i, o in enumerate(observations.reflectors.values()) if i in used]
    tips = sum(bool(np.isnan(offset).any()) for offset in offsets)
    unknowns = count_artefact_unknowns(observations) + 3 * tips
    return int(observations.freedom.sum()) + int(touched.sum()) - unknowns


def require_spare(observations: Observations, files: str) -> None:
    """Raise `BadInput` where placements and unknown seats would explain any readings."""
    if count_spare_rows(observations) <= 0:
        placements = len(np.unique(observations.placement))
        raise BadInput(
            files,
            "readings",
            f"{observations.n} at rest in {placements} placement{'s' if placements > 1 else ''}",
            "more than placements and seats take up (three certified targets in one placement, "
            "or seats touched from many sides)",
        )


def _complete(raw: Observations, arm: Arm) -> Mask:
    """Select readings that have the temperatures of all joints; all readings, if none has."""
    complete = np.asarray(np.isfinite(raw.states.temperature_c[:, arm.used_columns]).all(axis=1))
    return complete if complete.any() else np.ones(raw.n, dtype=bool)


def _rests(raw: Observations) -> I64:
    """Return the number of each reading's rest."""
    if raw.n == 0:
        return np.zeros(0, dtype=np.int64)
    q, side = raw.states.q, np.sign(np.nan_to_num(raw.states.rate))
    begins = np.ones(raw.n, dtype=bool)
    begins[1:] = (
        (np.abs(np.diff(q, axis=0)).max(axis=1) > REST_RAD)
        | (np.diff(raw.placement) != 0)
        | (np.diff(raw.target) != 0)
        | (np.diff(raw.reflector) != 0)
        | (np.diff(raw.session) != 0)
        | (np.diff(side, axis=0) != 0).any(axis=1)
        | raw.has_truth[1:]
    )
    return np.cumsum(begins) - 1


def assign_folds(rests: Rests) -> I64:
    """Return the fold (n,) of each rest: whole placements, dealt in turn.

    A single placement is divided into blocks of time; a posture belongs to the block of its first
    reading.
    """
    observations = rests.observations
    folds = assign_group_folds(observations.placement, MOST_FOLDS)
    return folds if folds.any() else assign_posture_folds(rests.points, BLOCKS)[rests.point_of]

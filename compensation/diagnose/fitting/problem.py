"""The sessions as one linear problem around a model: residuals, and what may absorb them.

Rows are flat: x, y, z of every rest in mm, then one row per certified distance. Readings taken
one after another at one rest are not independent; they enter as their mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from armd.compensation.data.session import Session
from armd.compensation.effects.effect import ArtefactChange
from armd.compensation.estimate.observations import Observations, gather
from armd.compensation.estimate.poses import (
    Poses,
    centres,
    fit_poses,
    pose_columns,
    target_columns,
)
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import basis_values, parameter_rows
from armd.compensation.model.calibration import ArtefactCorrection
from armd.compensation.model.kinematics import jacobian, joint_jacobian
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term
from armd.errors import BadInput

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

#: Readings closer than this in every joint, in sequence at one target, are one rest.
REST_RAD = 1e-4
#: A length that a temperature would change.
LEAST_LENGTH_MM = 1.0


@dataclass(frozen=True)
class ModelState:
    """A model at one point of the search: constants, terms, corrections of the artefact."""

    constants: F64  # (P,)
    terms: tuple[Term, ...]
    reference_c: float
    artefact: ArtefactCorrection


@dataclass(frozen=True)
class Rests:
    """What was measured, one row per rest, and which readings made each."""

    sessions: tuple[Session, ...]
    observations: Observations  # n rests
    artefact_rise_c: F64  # (n,) artefact temperature − its reference, 0 missing
    rest_of: I64  # (readings,) rest of each reading, through all sessions; −1 not used
    first: I64  # (n,) a reading of each rest
    target_label: tuple[str, ...]  # per target: its name within the artefact

    @property
    def n(self) -> int:
        return self.observations.n


@dataclass(frozen=True)
class Linear:
    """Residuals and columns around a model; N = 3 n + distances rows."""

    rests: Rests
    model: ModelState
    poses: Poses
    residual: F64  # (N,) mm
    jacobian: F64  # (P, N) mm per parameter
    joints: F64  # (n, 3, joints) mm/rad, for the encoders' noise
    nuisance: F64  # (N, m) placements, unknown seats

    def signature(self, parameter: int, values: F64) -> F64:
        """Column (N,) of a parameter times basis values (n,)."""
        column: F64 = self.jacobian[parameter].copy()
        column[: 3 * self.rests.n] *= np.repeat(values, 3)
        return column

    def artefact_column(self, change: ArtefactChange) -> F64:
        """Column (N,) of a change of the artefact: the residual is tip minus target."""
        observations = self.rests.observations
        column = np.zeros(len(self.residual))
        if change.kind == "distance":
            column[3 * self.rests.n + change.index] = -1.0
            return column
        if change.kind == "moved":
            column[: 3 * self.rests.n] = -self._moved(change).ravel()
            return column
        at = observations.known_mm(self.poses.target_mm)
        if change.kind == "expansion":
            move = at * self.rests.artefact_rise_c[:, None]
        elif change.kind == "scale":
            move = at
        else:
            label = np.array(self.rests.target_label)[observations.target]
            move = np.zeros((self.rests.n, 3))
            move[(label == change.target) & ~observations.has_truth, change.axis] = 1.0
        if change.artefact:
            of = np.array([s.artefact.name == change.artefact for s in self.rests.sessions])
            move = move * of[observations.session][:, None]
        rotation = self.poses.rotation[observations.placement]
        column[: 3 * self.rests.n] = -np.einsum("nij,nj->ni", rotation, move).ravel()
        return column

    def _moved(self, change: ArtefactChange) -> F64:
        """Motion (n, 3) of the targets of one placement, of its later rests in time."""
        observations = self.rests.observations
        own = np.flatnonzero(observations.placement == change.index)
        own = own[np.argsort(observations.states.time_s[own], kind="stable")]
        points = self.poses.placed(observations)[own]
        along = np.eye(3)[change.axis % 3]
        moves = np.zeros((self.rests.n, 3))
        turned = np.cross(along, points - points.mean(axis=0))
        moves[own] = along if change.axis < 3 else turned
        moves[own[: change.after]] = 0.0
        return moves


def gather_rests(sessions: Sequence[Session], arm: Arm) -> Rests:
    """Join sessions and average the readings of each rest."""
    raw = gather(sessions, arm)
    rise = np.concatenate([s.artefact_c - s.artefact.reference_temperature_c for s in sessions])
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
    )
    labels = tuple(name for s in sessions for name in s.artefact.target_names)
    return Rests(
        tuple(sessions),
        observations,
        np.nan_to_num(mean(rise)),
        rest_of_reading,
        np.flatnonzero(used)[first],
        labels,
    )


def spare_rows(observations: Observations) -> int:
    """Numbers measured beyond those that placements and unknown seats take up."""
    placements = len(np.unique(observations.placement))
    seats = np.unique(observations.target[~observations.has_truth])
    seats = seats[observations.unknown[seats]]
    touched = np.isin(observations.distances.between, seats).all(axis=1)
    return 3 * observations.n + int(touched.sum()) - 6 * placements - 3 * len(seats)


def require_spare(observations: Observations, files: str) -> None:
    """Raises `BadInput` where placements and unknown seats explain any reading whatever."""
    if spare_rows(observations) <= 0:
        placements = len(np.unique(observations.placement))
        raise BadInput(
            files,
            "readings",
            f"{observations.n} at rest in {placements} placement{'s' if placements > 1 else ''}",
            "more than placements and seats take up (three certified targets in one placement, "
            "or seats touched from many sides)",
        )


def _complete(raw: Observations, arm: Arm) -> npt.NDArray[np.bool_]:
    """Readings that have the temperatures of all joints; all of them, if none has."""
    columns = [arm.sensors.index(name) for name in arm.used_sensors]
    complete = np.asarray(np.isfinite(raw.states.temperature_c[:, columns]).all(axis=1))
    return complete if complete.any() else np.ones(raw.n, dtype=bool)


def _rests(raw: Observations) -> I64:
    """Number of the rest of every reading."""
    if raw.n == 0:
        return np.zeros(0, dtype=np.int64)
    q, side = raw.states.q, np.sign(np.nan_to_num(raw.states.rate))
    new = np.ones(raw.n, dtype=bool)
    new[1:] = (
        (np.abs(np.diff(q, axis=0)).max(axis=1) > REST_RAD)
        | (np.diff(raw.placement) != 0)
        | (np.diff(raw.target) != 0)
        | (np.diff(raw.session) != 0)
        | (np.diff(side, axis=0) != 0).any(axis=1)
        | raw.has_truth[1:]
    )
    return np.cumsum(new) - 1


def linearise(rests: Rests, model: ModelState, arm: Arm) -> Linear:
    """Fit placements and unknown seats under *model*; everything else becomes columns."""
    observations = _corrected(rests, model.artefact)
    values = basis_values(model.terms, observations.states, arm, model.reference_c, model.constants)
    if not np.isfinite(values).all():
        files = ", ".join(str(session.path) for session in rests.sessions)
        needs = "those that the model under test needs"
        missing = np.isnan(observations.states.temperature_c).any()
        what = "temperatures" if missing else "times"
        raise BadInput(files, what, "missing in some readings", needs)
    rows = parameter_rows(model.constants, model.terms, values)
    position, columns = jacobian(observations.states.q, rows)
    poses = fit_poses(observations, position)
    distances = observations.distances
    n, n_distances = observations.n, len(distances.length_mm)
    size = 3 * n + n_distances
    parameters = np.zeros((columns.shape[2], size))
    parameters[:, : 3 * n] = columns.reshape(3 * n, -1).T
    residual = np.zeros(size)
    residual[: 3 * n] = poses.residual(observations, position).ravel()
    apart = poses.target_mm[distances.between[:, 0]] - poses.target_mm[distances.between[:, 1]]
    length = np.linalg.norm(apart, axis=1)
    residual[3 * n :] = length - distances.length_mm
    direction = apart / np.maximum(length, 1e-12)[:, None]
    return Linear(
        rests=replace(rests, observations=observations),
        model=model,
        poses=poses,
        residual=residual,
        jacobian=parameters,
        joints=joint_jacobian(observations.states.q, rows),
        nuisance=np.hstack(
            [
                _nuisance(observations, poses, position, direction, size),
                _lost_lengths(rests, model, parameters),
            ]
        ),
    )


def _lost_lengths(rests: Rests, model: ModelState, jacobian: F64) -> F64:
    """Columns (N, m) of the lengths of links whose sensor shows nothing: free in each session, at
    its beginning and at its end, for nobody knows how warm they were."""
    states, session_of = rests.observations.states, rests.observations.session
    layout, n = ParameterLayout(states.q.shape[1]), rests.n
    columns = []
    for number, session in enumerate(rests.sessions):
        here = (session_of == number).astype(float)
        shares = [here]
        if np.isfinite(states.time_s).all() and np.ptp(states.time_s[here > 0], axis=0) > 0:
            time_s = states.time_s - states.time_s[here > 0].mean()
            shares.append(here * time_s / np.abs(time_s[here > 0]).max())
        for name in (f"{length}_{k}" for k in session.lost_links for length in "da"):
            at = layout.index(name)
            if abs(model.constants[at]) > LEAST_LENGTH_MM:
                for share in shares:
                    column = jacobian[at].copy()
                    column[: 3 * n] *= np.repeat(share, 3)
                    columns.append(column)
    return np.stack(columns, axis=1) if columns else np.zeros((jacobian.shape[1], 0))


def _corrected(rests: Rests, correction: ArtefactCorrection) -> Observations:
    """The observations under a correction of the artefact, as `identify` applies it."""
    observations = rests.observations
    corrected = gather(rests.sessions, observations.arm, correction)
    return replace(
        observations,
        stretch=corrected.stretch[rests.first],
        position_mm=corrected.position_mm,
    )


def _nuisance(
    observations: Observations, poses: Poses, position: F64, direction: F64, size: int
) -> F64:
    """Columns (N, m) of every placement's pose and every unknown seat's position."""
    n, first = observations.n, 6 * len(observations.placement_names)
    seats = np.flatnonzero(observations.unknown)
    at = {int(k): first + 3 * j for j, k in enumerate(seats)}  # of each seat's columns
    columns = np.zeros((size, first + 3 * len(seats)))
    rows = 3 * np.arange(n)[:, None] + np.arange(3)
    pose_block = pose_columns(observations, position, centres(observations, position))
    for j in range(6):
        columns[rows, (6 * observations.placement + j)[:, None]] = pose_block[:, :, j]
    there = np.flatnonzero(observations.unknown[observations.target])
    begin = np.array([at[int(k)] for k in observations.target[there]], dtype=np.int64)
    target_block = target_columns(observations, poses)[there]
    for j in range(3):
        columns[rows[there], (begin + j)[:, None]] = target_block[:, :, j]
    for i, (a, b) in enumerate(observations.distances.between):
        for end, sign in ((int(a), 1.0), (int(b), -1.0)):
            if end in at:
                columns[3 * n + i, at[end] : at[end] + 3] = sign * direction[i]
    kept: F64 = columns[:, np.abs(columns).max(axis=0, initial=0.0) > 0.0]
    return kept

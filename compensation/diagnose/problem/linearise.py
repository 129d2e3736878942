"""The linear problem of the sessions around a model: placements fitted, residuals, columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.problem.linear import Linear, ModelState, Rests
from armd.compensation.estimate.linear.blocks import Blocks, Piece, to_blocks
from armd.compensation.estimate.linearise import Linearisation, linearise_as_read
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.estimate.surface_kinds import FREEDOM, PLANE
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.calibration import ArtefactCorrection
from armd.compensation.model.parameters import LEAST_LENGTH_MM, ParameterLayout
from armd.errors import BadInput


def linearise(rests: Rests, model: ModelState, arm: Arm) -> Linear:
    """Fit placements and unknown seats under *model*; everything else becomes columns.

    Raises `BadInput` where readings lack temperatures or times that the model needs.
    """
    observations = _corrected(rests, model.artefact)
    values = compute_basis_values(
        model.terms, observations.states, arm, model.reference_c, model.constants
    )
    if not np.isfinite(values).all():
        files = ", ".join(str(session.path) for session in rests.sessions)
        needs = "those that the model under test needs"
        missing = np.isnan(observations.states.temperature_c).any()
        quantity = "temperatures" if missing else "times"
        raise BadInput(files, quantity, "missing in some readings", needs)
    off_tip_mm = _off_tip_mm(observations, model)
    linearisation = linearise_as_read(
        observations, model.constants, model.terms, values, off_tip_mm
    )
    n, distances = observations.n, observations.distances
    parameters = np.zeros((linearisation.jacobian.shape[2], 3 * n + len(distances.length_mm)))
    parameters[:, : 3 * n] = linearisation.jacobian.reshape(3 * n, -1).T
    length, direction = linearisation.poses.measure_distances(distances.between)
    flat = observations.kind[distances.between[:, 0]] == PLANE  # only the third coordinate counts
    direction[flat, :2] = 0.0
    nuisance: list[F64 | Blocks] = [
        _nuisance(linearisation, direction),
        _lost_lengths(rests, model, parameters),
    ]
    if observations.reflectors:
        nuisance.append(_reflector_columns(observations, parameters))
    return Linear(
        rests=replace(rests, observations=observations),
        model=model,
        poses=linearisation.poses,
        residual=np.append(linearisation.residual_mm.ravel(), length - distances.length_mm),
        jacobian=parameters,
        joints=np.ascontiguousarray(linearisation.joints),
        nuisance=to_blocks(nuisance, observations.placement),
        position_mm=linearisation.position_mm,
        normal=_normals(linearisation),
    )


def _off_tip_mm(observations: Observations, model: ModelState) -> F64 | None:
    """Return offsets (n, 3) mm from the tip to each reading's point, in the last frame.

    None: all readings are of the tip.
    """
    if not observations.reflectors:
        return None
    sits = np.array([*(model.off_tip_mm[name] for name in observations.reflectors), np.zeros(3)])
    offset_mm: F64 = sits[observations.reflector]  # index -1, the last row: the tip
    return offset_mm


def _reflector_columns(observations: Observations, jacobian: F64) -> F64:
    """Return columns (N, m) of unknown reflector positions: the tip's, in their readings."""
    names = list(observations.reflectors)
    unknown = [i for i, name in enumerate(names) if np.isnan(observations.reflectors[name]).any()]
    columns = [np.zeros((jacobian.shape[1], 0))]
    for i in unknown:
        column = jacobian[observations.arm.layout.tip].T.copy()
        column[: 3 * observations.n] *= np.repeat(observations.reflector == i, 3)[:, None]
        columns.append(column)
    return np.hstack(columns)


def _lost_lengths(rests: Rests, model: ModelState, jacobian: F64) -> F64:
    """Return the columns (N, m) of the lengths of links whose sensor is lost.

    Such a length is free in each session at its beginning and at its end, since the link's
    temperature is unknown.
    """
    states, session_of = rests.observations.states, rests.observations.session
    layout, n = ParameterLayout(states.q.shape[1]), rests.n
    columns = []
    for number, session in enumerate(rests.sessions):
        in_session = (session_of == number).astype(float)
        shares = [in_session]
        if np.isfinite(states.time_s).all() and np.ptp(states.time_s[in_session > 0], axis=0) > 0:
            time_s = states.time_s - states.time_s[in_session > 0].mean()
            shares.append(in_session * time_s / np.abs(time_s[in_session > 0]).max())
        for name in (f"{length}_{k}" for k in session.lost_links for length in "da"):
            index = layout.index(name)
            if abs(model.constants[index]) > LEAST_LENGTH_MM:
                for share in shares:
                    column = jacobian[index].copy()
                    column[: 3 * n] *= np.repeat(share, 3)
                    columns.append(column)
    return np.stack(columns, axis=1) if columns else np.zeros((jacobian.shape[1], 0))


def _corrected(rests: Rests, correction: ArtefactCorrection) -> Observations:
    """Return the observations under a correction of the artefact, as `identify` applies it."""
    observations = rests.observations
    corrected = collect_observations(rests.sessions, observations.arm, correction)
    return replace(
        observations,
        stretch=corrected.stretch[rests.first],
        position_mm=np.vstack(
            [corrected.position_mm, observations.position_mm[len(corrected.position_mm) :]]
        ),
    )


def _normals(linearisation: Linearisation) -> F64 | None:
    """Return normals (n, 3) of the surfaces that readings touch; None where none does."""
    touched = linearisation.observations.on_surface.any()
    return (
        linearisation.poses.compute_normals(linearisation.observations, linearisation.position_mm)
        if touched
        else None
    )


def _moving(pose: F64, freedom: int) -> F64:
    """Return the part (m, 3, *freedom*) of a surface's pose columns that moves the surface.

    The pose columns are (m, 3, 6). The other combinations (a plane's shift within itself, a
    sphere's turn) are rounding, and would count as known.
    """
    turned = np.linalg.svd(pose.reshape(-1, 6), full_matrices=False)[2]
    moving: F64 = pose @ turned[:freedom].T
    return moving


def _nuisance(linearisation: Linearisation, direction: F64) -> Blocks:
    """Return the columns (N, m) of every placement's pose and every unknown seat's position.

    *direction* (D, 3): of the certified distances.
    """
    observations = linearisation.observations
    first = 6 * len(observations.placement_names)
    seats = np.flatnonzero(observations.unknown)
    begins = {int(k): first + 3 * j for j, k in enumerate(seats)}  # first column of each seat
    pieces = []
    for number in np.unique(observations.placement):
        rests = np.flatnonzero(observations.placement == number)
        target = observations.target[rests]
        touched = [int(k) for k in np.unique(target) if int(k) in begins]
        of_seats = [
            linearisation.target_columns[rests] * (target == k)[:, None, None] for k in touched
        ]
        pose = linearisation.pose_columns[rests]
        if observations.on_surface[rests[0]]:
            pose = _moving(pose, FREEDOM[int(observations.kind[target[0]])])
        values = np.concatenate([pose, *of_seats], axis=2)
        of_pose = 6 * number + np.arange(pose.shape[2])
        numbers = [of_pose, *(begins[k] + np.arange(3) for k in touched)]
        nonzero = values.any(axis=(0, 1))
        pieces.append(Piece(rests, np.concatenate(numbers)[nonzero], values[:, :, nonzero]))
    distances = np.zeros((len(direction), first + 3 * len(seats)))
    for i, (a, b) in enumerate(observations.distances.between):
        for end, sign in ((int(a), 1.0), (int(b), -1.0)):
            if end in begins:
                distances[i, begins[end] : begins[end] + 3] = sign * direction[i]
    columns = Blocks(observations.n, distances.shape[1], tuple(pieces), distances)
    at_distances = np.flatnonzero(distances.any(axis=0))
    return columns.only(np.unique(np.concatenate([at_distances, *(p.columns for p in pieces)])))

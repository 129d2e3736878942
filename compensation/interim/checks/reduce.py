"""Reduces one check to whitened rows from which placements and seats are eliminated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.constants import REST_RAD
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.estimate.placements.poses import (
    Poses,
    compute_centres,
    make_pose_columns,
    make_target_columns,
)
from armd.compensation.interim.checks.catalogue_digest import hash_catalogue
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.checks.open_growth import list_open_growth
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.checks.signals import Signals
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.errors import BadInput
from armd.terminal.counted import format_count

#: Nuisance directions shorter than this, relative to the longest, are ignored.
NUISANCE_RANK = 1e-6
#: The noise of a certified length or position in addition to its constant error, mm.
LENGTH_FLOOR_MM = 1e-4
#: The fewest rows beyond placement and seats with which a check is accepted.
LEAST_ROWS = 6


def reduce(
    session: Session, arm: Arm, calibration: Calibration, causes: Sequence[Cause]
) -> Reduced:
    """Reduce *session*; raises `BadInput` where it determines nothing."""
    observations = _select_usable(
        collect_observations([session], arm, calibration.artefact), arm, calibration, session
    )
    states = observations.states
    signals = Signals(states, arm, calibration)
    position = signals.position_mm
    poses = fit_poses(observations, position)
    placed = poses.compute_target_points(observations)
    share = _compute_rest_share(observations)
    whitener = signals.compute_whitener() * share[:, None, None]

    def whitened(columns: F64) -> F64:
        """Return whitened columns (3 n, C) from columns (n, 3, C)."""
        return (whitener @ columns).reshape(3 * observations.n, columns.shape[2])

    cause_columns = signals.compute_motions(
        [column for cause in causes for column in cause.candidate.columns]
    )
    growth = list_open_growth(arm, calibration)
    calibration_errors = np.concatenate(
        [signals.compute_calibration_motions(), signals.compute_growth_motions(growth)], axis=2
    )
    shifts, touched = _make_target_shifts(observations, poses)
    extra = _make_distance_rows(observations, poses, touched)
    nuisance = np.concatenate([_make_placement_columns(observations, placed), shifts], axis=2)
    n_free = nuisance.shape[2] - shifts.shape[2]
    free = np.ones(nuisance.shape[2], dtype=bool)
    free[n_free:] = np.repeat(observations.unknown[touched], 3)
    rows = len(extra.residual)
    wide = np.zeros((3 * observations.n + rows, nuisance.shape[2]))
    wide[: 3 * observations.n] = whitened(nuisance)
    wide[3 * observations.n :, n_free:] = extra.columns
    clear = _make_clear_basis(wide[:, free])
    errors = np.zeros((len(wide), 0))
    error_names: list[str] = []
    certified = observations.uncertainty_mm[touched]
    for t, target in enumerate(touched):
        if not observations.unknown[target] and certified[t] > 0:
            block = wide[:, n_free + 3 * t : n_free + 3 * t + 3] * certified[t]
            errors = np.concatenate([errors, block], axis=1)
            label = _label_target(session, int(target))
            error_names += [f"{label} {axis}" for axis in "xyz"]
    wrong_lengths = np.concatenate([np.zeros((3 * observations.n, rows)), extra.errors])
    residual = np.concatenate([whitened((position - placed)[:, :, None])[:, 0], extra.residual])

    def below(columns: F64) -> F64:
        return np.concatenate([columns, np.zeros((rows, columns.shape[1]))])

    cleared = clear.T @ residual
    rests = round(float((share**2).sum()))
    spare = len(cleared) - 3 * (
        observations.n - rests
    )  # further readings of a rest add no information
    if spare < LEAST_ROWS:
        at_rests = "" if rests == observations.n else f" at {format_count(rests, 'rest')}"
        problem = (
            f"{format_count(session.n, 'reading')}{at_rests},"
            f" {spare} numbers beyond placement and seats"
        )
        raise BadInput(session.path, "the session", problem, "10 to 30 readings in several poses")
    return Reduced(
        residual=cleared,
        causes=clear.T @ below(whitened(cause_columns)),
        error_columns=clear.T
        @ np.concatenate([below(whitened(calibration_errors)), errors, wrong_lengths], axis=1),
        known_names=(
            *(f"calibrated {i}" for i in range(calibration_errors.shape[2] - len(growth))),
            *(expansion.name for expansion in growth),
            *error_names,
            *(f"{session.artefact.name} distance {i}" for i in extra.numbers),
        ),
        targets=clear.T @ wide[:, n_free:],
        target_names=tuple(_label_target(session, int(target)) for target in touched),
        certified=tuple(bool(x) for x in ~observations.unknown[touched]),
        mean_unix_s=float(states.time_s.mean()),
        first_unix_s=float(states.time_s.min()),
        last_unix_s=float(states.time_s.max()),
        readings=observations.n,
        rms_um=1e3 * float(np.sqrt(np.mean(np.sum((position - placed) ** 2, axis=1)))),
        catalogue=hash_catalogue(causes, growth),
        temperature_c=_summarise_temperatures(observations, arm),
    )


@dataclass(frozen=True)
class _Lengths:
    residual: F64  # (D,)
    columns: F64  # (D, 3 T)
    errors: F64  # (D, D) per standard deviation of the certificate
    numbers: tuple[int, ...]


def _label_target(session: Session, target: int) -> str:
    return f"{session.artefact.name} {session.artefact.target_names[target]}"


def _select_usable(
    observations: Observations, arm: Arm, calibration: Calibration, session: Session
) -> Observations:
    """Select the readings that have all temperatures that the model needs; raises `BadInput`.

    Every reading needs a time, and one reading at least has to be usable.
    """
    if not np.isfinite(observations.states.time_s).all():
        raise BadInput(session.path, "time_s", "nothing", "the time of every reading")
    good = np.asarray(Signals(observations.states, arm, calibration).complete)
    if not good.any():
        problem = "no reading with all temperatures that the calibration needs"
        raise BadInput(session.path, "the readings", problem, "some")
    return observations.rows(good)


def _summarise_temperatures(observations: Observations, arm: Arm) -> dict[str, tuple[float, float]]:
    """Return the lowest and highest temperature of each sensor that read anything."""
    range_c = {}
    for name, celsius in zip(arm.sensors, observations.states.temperature_c.T, strict=True):
        finite_c = celsius[np.isfinite(celsius)]
        if len(finite_c):
            range_c[name] = float(finite_c.min()), float(finite_c.max())
    return range_c


def _compute_rest_share(observations: Observations) -> F64:
    """Return a factor (n,) for each reading, so that the readings of one rest share its weight."""
    q, target = observations.states.q, observations.target
    begins = np.ones(observations.n, dtype=bool)
    begins[1:] = (target[1:] != target[:-1]) | (np.abs(np.diff(q, axis=0)) > REST_RAD).any(axis=1)
    rest = np.cumsum(begins) - 1
    share: F64 = 1.0 / np.sqrt(np.bincount(rest)[rest])
    return share


def _make_placement_columns(observations: Observations, placed: F64) -> F64:
    """Make the columns (n, 3, 6 P) of the placements."""
    motions = make_pose_columns(observations, placed, compute_centres(observations, placed))
    n_placements = len(observations.placement_names)
    columns = np.zeros((observations.n, 3, n_placements, 6))
    columns[np.arange(observations.n), :, observations.placement] = motions
    return columns.reshape(observations.n, 3, 6 * n_placements)


def _make_target_shifts(observations: Observations, poses: Poses) -> tuple[F64, I64]:
    """Make the columns (n, 3, 3 T) of the touched targets' shifts, and return the
    targets' indices.
    """
    touched = np.unique(observations.target[~observations.has_truth])
    motions = make_target_columns(observations, poses)
    columns = np.zeros((observations.n, 3, len(touched), 3))
    for t, target in enumerate(touched):
        rows = observations.target == target
        columns[rows, :, t] = motions[rows]
    return columns.reshape(observations.n, 3, 3 * len(touched)), touched


def _make_distance_rows(observations: Observations, poses: Poses, touched: I64) -> _Lengths:
    """Make rows for the certified lengths between touched targets."""
    lengths, place = observations.distances, {int(t): i for i, t in enumerate(touched)}
    residual, columns, errors, numbers = [], [], [], []
    for d, (a, b) in enumerate(lengths.between):
        if int(a) not in place or int(b) not in place:
            continue
        offset_mm = poses.target_mm[a] - poses.target_mm[b]
        size = float(np.linalg.norm(offset_mm))
        row = np.zeros((len(touched), 3))
        row[place[int(a)]], row[place[int(b)]] = offset_mm / size, -offset_mm / size
        residual.append((size - lengths.length_mm[d]) / LENGTH_FLOOR_MM)
        columns.append(row.ravel() / LENGTH_FLOOR_MM)
        errors.append(lengths.standard_uncertainty_mm[d] / LENGTH_FLOOR_MM)
        numbers.append(d)
    return _Lengths(
        np.array(residual),
        np.array(columns).reshape(len(residual), 3 * len(touched)),
        np.diag(errors) if errors else np.zeros((0, 0)),
        tuple(numbers),
    )


def _make_clear_basis(nuisance: F64) -> F64:
    """Return an orthonormal basis (rows, r) of the directions that no nuisance moves."""
    u, s, _ = np.linalg.svd(nuisance, full_matrices=True)
    rank = int((s > NUISANCE_RANK * s[0]).sum())
    return np.ascontiguousarray(u[:, rank:])

"""Evaluate sessions of any length for `armd evaluate`: readings are read twice, none is kept.

The first pass sums them into moments, from which poses and unknown seats are fitted. The second
pass compares each reading with the fit. `evaluate` does the same in memory; a test compares the
two.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from armd.arrays import F64
from armd.compensation.data.in_order import keep_freed_memory, run_in_order
from armd.compensation.data.sessions.files import READINGS
from armd.compensation.data.sessions.points_only import require_points
from armd.compensation.data.sessions.session import (
    Session,
    check_once,
    load_session_pieces,
    load_sessions,
)
from armd.compensation.data.soundness.turns import AngleRange, report_open_turns
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.estimate.placements.poses import Poses
from armd.compensation.identify.evaluation.condensed import PointMoments, compute_moments
from armd.compensation.identify.evaluation.evaluate import (
    make_temperature_fault,
    refuse_overflows,
)
from armd.compensation.identify.evaluation.evaluate_sessions import evaluate_sessions
from armd.compensation.identify.evaluation.lengths import Length, measure_certified_lengths
from armd.compensation.identify.evaluation.outside_range import OutsideRange
from armd.compensation.identify.evaluation.tally import ErrorTally
from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration, LoadedCalibration
from armd.compensation.model.state import follow_lag
from armd.compensation.model.terms import Term
from armd.compensation.progress import TellStep

#: Bytes of readings that are read at once: about 100 000 readings, which take no more memory than
#: reading in pieces.
MOST_AT_ONCE = 16 << 20
LONG = f"`armd evaluate` of more than {MOST_AT_ONCE >> 20} MiB of readings"


class _BackInTime(Exception):
    """Readings are not in the order of time, which a lag requires."""


def evaluate_files(
    paths: Sequence[str],
    arm: Arm,
    calibration: Calibration | None,
    progress: TellStep,
) -> tuple[dict[str, Any], list[Length]]:
    """Evaluate the session folders *paths* piece by piece, if `is_long`.

    Return the object of `--json` and the certified lengths.
    """
    keep_freed_memory()
    # The matrices are small: the library's own threads cost more than they gain.
    with threadpool_limits(limits=1, user_api="blas"):
        return _evaluate_files(paths, arm, calibration, progress)


def _evaluate_files(
    paths: Sequence[str],
    arm: Arm,
    calibration: Calibration | None,
    progress: TellStep,
) -> tuple[dict[str, Any], list[Length]]:
    check_once(paths)
    try:
        return _Passes(paths, arm, calibration, progress).evaluation()
    except _BackInTime:
        progress("the readings are not in the order of time: reading all at once …")
    figures, evaluation = evaluate_sessions(load_sessions(paths, arm), arm, calibration, progress)
    return figures, evaluation.lengths


def is_long(paths: Sequence[str | Path]) -> bool:
    """Return whether these session folders have too many readings to load at once."""
    files = [Path(path) / name for path in paths for name in READINGS]
    return sum(file.stat().st_size for file in files if file.is_file()) > MOST_AT_ONCE


@dataclass(frozen=True)
class _Piece:
    """Readings of one session, with the slow factors that depend on earlier readings."""

    session: int
    readings: Session
    slow: F64  # (n, L+T) values of the model's slow factors


class _Passes:
    def __init__(
        self, paths: Sequence[str], arm: Arm, calibration: Calibration | None, progress: TellStep
    ) -> None:
        self._paths, self._arm, self._progress = paths, arm, progress
        self._calibration = calibration
        self._outside = OutsideRange(arm, calibration)
        self._artefact = calibration.artefact if calibration else None
        self._terms: Sequence[Term] = calibration.terms if calibration else []
        loaded = LoadedCalibration(calibration, "", Path()) if calibration else None
        self._model = Model(arm, loaded)
        self._last: dict[int, Session] = {}  # last piece of a session; it names all placements
        self._n = 0
        self._missing = np.zeros(len(arm.sensors), np.int64)
        self._remarks: list[str] = []
        self._turned: dict[int, AngleRange] = {}  # each session's joints

    def evaluation(self) -> tuple[dict[str, Any], list[Length]]:
        moments: dict[_Key, PointMoments] = {}
        for piece_moments in run_in_order(self._moments, self._pieces("summing", self._note)):
            for key, new in piece_moments.items():
                if key in moments:
                    moments[key].add(new)
                else:
                    moments[key] = new
        bare = [session.rows(np.zeros(0, np.int64)) for session in self._last.values()]
        observations = collect_observations(bare, self._arm, self._artefact, every_length=True)
        if not moments:
            raise make_temperature_fault(observations, self._terms, self._n, self._missing)
        few, weight, position = _condense(observations, moments)
        poses = fit_poses(few, position, weight)
        residual = poses.residual(few, position)
        lengths = measure_certified_lengths(few, poses, residual, weight)

        by_session = [ErrorTally() for _ in self._paths]
        poses_by_session = [_select_session(poses, observations, i) for i in range(len(bare))]

        def distances_um(piece: _Piece) -> tuple[int, F64]:
            usable, tip = self._tips(piece)
            residual_mm = poses_by_session[piece.session].residual(usable, tip)
            return piece.session, 1e3 * np.linalg.norm(residual_mm, axis=1)

        for session, distance in run_in_order(
            distances_um, self._pieces("comparing", lambda *_: None)
        ):
            by_session[session].add(distance)
        together = ErrorTally.merge(by_session)
        names = observations.session_names
        result = {
            **together.as_json(),
            "n_unused": self._n - together.n,
            "by_session": {n: t.as_json() for n, t in zip(names, by_session, strict=True)},
            "distances": [length.as_json() for length in lengths],
            "reflectors": {},
            "remarks": [*self._remarks, *self._open_turns(), *self._outside.in_words()],
        }
        return result, lengths

    def _pieces(self, doing: str, note: Callable[[int, Session], None]) -> Iterator[_Piece]:
        n = 0
        for i, path in enumerate(self._paths):
            lags = _Lags()
            for session in load_session_pieces(path, self._arm):
                require_points([session], LONG)
                note(i, session)
                n += session.n
                self._progress(f"{doing}: {n} readings")
                yield _Piece(i, session, self._model.slow_values(session.states, delay=lags.follow))

    def _note(self, i: int, session: Session) -> None:
        """Keep what the remarks at the end need from a piece."""
        self._last[i] = session
        self._n += session.n
        self._remarks += session.remarks
        celsius = session.states.temperature_c
        self._outside.add(i, session.name, celsius)
        turned = self._turned.get(i)
        q = session.states.q
        self._turned[i] = turned.widened(q) if turned else AngleRange.from_angles(session.name, q)
        self._missing += np.isnan(celsius).sum(axis=0)

    def _open_turns(self) -> list[str]:
        remarks = report_open_turns(list(self._turned.values()), self._arm)
        return [remark for session in remarks for remark in session]

    def _tips(self, piece: _Piece) -> tuple[Observations, F64]:
        """Return the readings that have every temperature they need, and their tips (n, 3)."""
        readings = collect_observations([piece.readings], self._arm, self._artefact)
        tip = self._model.position_rows(readings.states, piece.slow)
        refuse_overflows(readings, tip, piece.slow)
        usable = np.isfinite(tip[:, 0])
        return (readings, tip) if usable.all() else (readings.rows(usable), tip[usable])

    def _moments(self, piece: _Piece) -> dict[_Key, PointMoments]:
        """Return moments by session, placement, target and kind.

        The points are (stretch, tip), or (truth, tip) of readings with a truth of their own.
        """
        readings, tip = self._tips(piece)
        n_targets = len(readings.target_names)
        moments_by_key = {}
        for true in (False, True):
            mask = readings.has_truth == true
            if not mask.any():
                continue
            rows = slice(None) if mask.all() else mask
            first = readings.truth_mm if true else readings.stretch[:, None]
            points = np.hstack([first[rows], tip[rows]])
            pair = readings.placement[rows] * n_targets + readings.target[rows]
            for code, moments in compute_moments(pair, points).items():
                moments_by_key[piece.session, *divmod(code, n_targets), true] = moments
        return moments_by_key


#: session, placement and target within it, whether the readings have truths of their own
_Key = tuple[int, int, int, bool]


class _Lags:
    """Delay temperatures from piece to piece."""

    def __init__(self) -> None:
        self._memory: dict[str, F64] = {}

    def follow(self, name: str, value: F64, time_s: F64, lag_s: float) -> F64:
        memory = self._memory.setdefault(name, np.full((1, 3), np.nan))
        if memory[0, 0] > time_s[0] or (np.diff(time_s) < 0).any():
            raise _BackInTime
        return follow_lag(time_s, value[:, None], lag_s, memory)[:, 0]


def _select_session(poses: Poses, observations: Observations, session: int) -> Poses:
    placements = observations.placement_session == session
    return Poses(
        poses.rotation[placements],
        poses.translation_mm[placements],
        poses.target_mm[observations.target_session == session],
    )


def _condense(
    observations: Observations, moments: dict[_Key, PointMoments]
) -> tuple[Observations, F64, F64]:
    """Return a few readings that replace all, their weights in readings, and their tips (m, 3)."""
    sessions = np.arange(len(observations.session_names))
    first_placement = np.searchsorted(observations.placement_session, sessions)
    first_target = np.searchsorted(observations.target_session, sessions)
    session, placement, target = list[int](), list[int](), list[int]()
    stretch, truth, tip, weight = list[float](), list[F64](), list[F64](), list[float]()
    for (i, p, k, true), group_moments in moments.items():
        points = group_moments.points()
        for point in points:
            session.append(i)
            placement.append(first_placement[i] + p)
            target.append(first_target[i] + k)
            stretch.append(1.0 if true else point[0])
            truth.append(point[:3] if true else np.full(3, np.nan))
            tip.append(point[-3:])
            weight.append(group_moments.n / len(points))
    few = replace(
        observations,
        states=replace(observations.states, q=np.zeros((len(session), observations.arm.n_joints))),
        session=np.array(session),
        row=np.zeros(len(session), np.int64),
        placement=np.array(placement),
        target=np.array(target),
        truth_mm=np.array(truth),
        stretch=np.array(stretch),
        reflector=np.full(len(session), -1),
        measured_turn=np.full((len(session), 3, 3), np.nan),
        turned=np.zeros(len(session), dtype=bool),
    )
    return few, np.array(weight), np.array(tip)

"""Readings of several sessions as one problem: one table with common numbering.

Placements and targets are numbered through all sessions. A placement and an artefact's unknown
points belong to their session: two sessions never share them, even where their names agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.data.sessions.format import Distance
from armd.compensation.data.sessions.session import Session, make_distinct_names
from armd.compensation.estimate.group_rows import group_rows
from armd.compensation.estimate.noise.postures import number_postures
from armd.compensation.estimate.surface_kinds import PLANE, POINT, TURN, list_kinds, list_placements
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import ArtefactCorrection
from armd.compensation.model.state import States
from armd.errors import BadInput

#: An orientation error of 1 rad counts as an error of so many mm.
TURN_MM = 100.0


@dataclass(frozen=True)
class Distances:
    """Certified lengths between targets, at the artefact's reference temperature."""

    between: I64  # (D, 2) indices of targets
    length_mm: F64  # (D,)
    standard_uncertainty_mm: F64  # (D,)
    certificate: I64  # (D,) equal for the same entry of the same artefact's certificate


@dataclass(frozen=True, kw_only=True)
class Observations:
    """A table of n readings in P placements of K targets.

    Row i means: the tip stood at target[i] in placement[i], or at truth_mm[i] in that placement's
    frame where truth is given.

    A target that is a surface constrains one direction only. It has a placement of its own wherever
    it was touched. In that frame it is a plane at a height, or a sphere about the origin, or a
    cylinder about z. The third coordinate of its position is that height or its radius.
    """

    arm: Arm
    session_names: list[str]
    placement_names: list[str]
    target_names: list[str]
    states: States
    session: I64  # (n,)
    row: I64  # (n,) of its session's table, from 0
    placement: I64  # (n,)
    target: I64  # (n,)
    truth_mm: F64  # (n, 3), NaN where the target is used
    stretch: F64  # (n,) the artefact's size relative to its reference temperature
    kind: I64  # (K,) a point, or a kind of surface
    position_mm: F64  # (K, 3) certified, NaN for a seat
    uncertainty_mm: F64  # (K,) standard uncertainty per axis of a certified position
    certificate: I64  # (K,) equal for the same target of the same artefact's certificate
    placement_session: I64  # (P,)
    target_session: I64  # (K,)
    distances: Distances
    reflector: I64  # (n,) index into reflectors; -1: arm.toml's tip
    reflectors: dict[str, F64]  # offset (3,) mm in the last frame, NaN unknown
    measured_turn: F64  # (n, 3, 3) of the measured body in its placement's frame; NaN without
    turned: Mask  # (n,) rows that are orientations, not positions of the tip (`orientations`)

    @property
    def n(self) -> int:
        return len(self.target)

    @property
    def has_truth(self) -> Mask:
        """The rows (n,) whose own truth replaces the target."""
        return np.isfinite(self.truth_mm[:, 0])

    @property
    def unknown(self) -> Mask:
        """The targets (K,) without a certified position: seats."""
        return np.isnan(self.position_mm[:, 0])

    @property
    def says_size(self) -> Mask:
        """The targets (K,) with a certified value that gives the artefact's size; no plane."""
        has_size: Mask = ~self.unknown & (self.kind != PLANE)
        return has_size

    @cached_property
    def on_surface(self) -> Mask:
        """The rows (n,) that touch a surface, anywhere on it."""
        kind = self.kind[self.target]
        touched: Mask = (kind != POINT) & (kind != TURN) & ~self.has_truth
        return touched

    @property
    def freedom(self) -> I64:
        """The number (n,) of equations that each row gives."""
        return np.where(self.on_surface, 1, 3)

    @cached_property
    def rows_by_session(self) -> dict[int, dict[int, I64]]:
        """The rows of each placement of each session, both ascending; a placement's by target."""
        return group_rows(self.session, self.placement, self.target)

    @cached_property
    def posture(self) -> I64:
        """The number (n,) of each reading's posture, from 0 in the order of the readings."""
        target = np.where(self.has_truth, -1, self.target)
        return number_postures(self.states.q, self.placement, target)

    @property
    def n_postures(self) -> int:
        return int(self.posture.max(initial=-1)) + 1

    def name_row(self, i: int) -> str:
        """Return a reading's session, and its row counted from 1, as a person finds it."""
        return f"{self.session_names[self.session[i]]} row {self.row[i] + 1}"

    def get_known_mm(self, target_mm: F64) -> F64:
        """Return the points touched (n, 3) in the placement's frame, by target positions (K, 3)."""
        points = self.stretch[:, None] * target_mm[self.target]
        return np.where(self.has_truth[:, None], self.truth_mm, points)

    def rows(self, mask: Mask | I64) -> Observations:
        """Return the problem with some readings only; placements and targets keep their numbers.

        Lagged basis functions need all rows of a run: evaluate them before choosing rows.
        """
        return replace(
            self,
            states=self.states.rows(mask),
            session=self.session[mask],
            row=self.row[mask],
            placement=self.placement[mask],
            target=self.target[mask],
            truth_mm=self.truth_mm[mask],
            stretch=self.stretch[mask],
            reflector=self.reflector[mask],
            measured_turn=self.measured_turn[mask],
            turned=self.turned[mask],
        )


def collect_observations(
    sessions: Sequence[Session],
    arm: Arm,
    artefact: ArtefactCorrection | None = None,
    *,
    every_length: bool = False,
) -> Observations:
    """Join sessions; *artefact* corrects certified values by what a diagnosis found.

    Certified lengths to a seat that nobody touched are dropped, unless *every_length* (readings of
    the seat may be elsewhere). More lengths than the seat has coordinates determine its position,
    which no step from a guess would find.
    """
    names = make_distinct_names(sessions)
    corrections = [_get_correction(session, artefact) for session in sessions]
    reflectors = _collect_reflectors(sessions)
    placements_by_session = [list_placements(session) for session in sessions]
    counts = [len(placements) for placements, _ in placements_by_session]
    first_placement = np.concatenate([[0], np.cumsum(counts)])
    sizes = [len(session.artefact.target_names) for session in sessions]
    first_target = np.concatenate([[0], np.cumsum(sizes)])
    of_session = np.repeat(np.arange(len(sessions)), [session.n for session in sessions])
    return Observations(
        arm=arm,
        session_names=names,
        placement_names=[
            f"{name}/{placement}"
            for name, (placements, _) in zip(names, placements_by_session, strict=True)
            for placement in placements
        ],
        target_names=[
            f"{name}/{target}"
            for name, s in zip(names, sessions, strict=True)
            for target in s.artefact.target_names
        ],
        states=replace(States.joined([s.states for s in sessions]), series=of_session),
        session=of_session,
        row=np.concatenate([s.row for s in sessions]),
        placement=np.concatenate(
            [
                numbers + first
                for (_, numbers), first in zip(placements_by_session, first_placement, strict=False)
            ]
        ),
        target=np.concatenate(
            [s.target + first for s, first in zip(sessions, first_target, strict=False)]
        ),
        truth_mm=np.concatenate([s.truth_mm for s in sessions]),
        stretch=np.concatenate(
            [_compute_stretch(s, c) for s, c in zip(sessions, corrections, strict=True)]
        ),
        kind=np.concatenate([list_kinds(s.artefact) for s in sessions]),
        position_mm=np.concatenate(
            [_compute_positions(s, c) for s, c in zip(sessions, corrections, strict=True)]
        ),
        uncertainty_mm=np.concatenate([s.artefact.uncertainties_mm() for s in sessions]),
        certificate=_number_equal(
            [(s.artefact.name, entry) for s in sessions for entry in s.artefact.entries]
        ),
        placement_session=np.repeat(np.arange(len(sessions)), counts),
        target_session=np.repeat(np.arange(len(sessions)), sizes),
        distances=_make_distances(sessions, first_target, every_length),
        reflector=np.concatenate([_index_reflectors(s, list(reflectors)) for s in sessions]),
        reflectors=reflectors,
        measured_turn=np.concatenate([_get_turns(s) for s in sessions]),
        turned=np.zeros(len(of_session), dtype=bool),
    )


def _get_turns(session: Session) -> F64:
    """Return orientations (n, 3, 3); NaN for a session without any, at no cost of memory."""
    nothing = np.broadcast_to(np.full((1, 1, 1), np.nan), (session.n, 3, 3))
    return nothing if session.turn is None else session.turn


def _collect_reflectors(sessions: Sequence[Session]) -> dict[str, F64]:
    """Collect offsets of all reflectors in readings; raise `BadInput` where sessions differ."""
    offsets: dict[str, F64] = {}
    for session in sessions:
        for name in session.reflector_names:
            offset = np.array(session.offset_mm.get(name, (np.nan,) * 3), dtype=float)
            before = offsets.setdefault(name, offset)
            if not np.array_equal(before, offset, equal_nan=True):
                place, field = session.path / "session.toml", f"reflector {name}"
                expected = f"{before.tolist()}, as in another session (nan: not given)"
                raise BadInput(place, field, f"offset_mm {offset.tolist()}", expected)
    return offsets


def _index_reflectors(session: Session, names: Sequence[str]) -> I64:
    """Return the index (n,) of each reading's reflector in *names*; -1 without a reflector."""
    if session.reflector is None:
        return np.full(session.n, -1)
    numbers = np.array([names.index(name) for name in session.reflector_names], dtype=np.int64)
    return numbers[session.reflector]


def _number_equal(entries: Sequence[object]) -> I64:
    """Number the entries so that equal ones share a number."""
    texts = [repr(entry) for entry in entries]
    first = {text: i for i, text in reversed(list(enumerate(texts)))}
    return np.array([first[text] for text in texts], dtype=np.int64)


def _get_correction(session: Session, correction: ArtefactCorrection | None) -> ArtefactCorrection:
    """Return the correction for a session's artefact; none if it is of another artefact."""
    if correction is None:
        return ArtefactCorrection()
    named = not correction.artefacts or session.artefact.name in correction.artefacts
    return correction if named else ArtefactCorrection()


def _compute_stretch(session: Session, correction: ArtefactCorrection) -> F64:
    """Return the factors (n,) scale · (1 + expansion · ΔT)."""
    expansion = correction.expansion_per_k
    expansion = session.artefact.expansion_per_k if expansion is None else expansion
    return correction.scale * (1.0 + expansion * session.artefact_rise_k)


def _compute_positions(session: Session, correction: ArtefactCorrection) -> F64:
    positions = session.artefact.positions_mm()
    for name, offset in correction.target_offset_mm.items():
        if name in session.artefact.target_names:
            positions[session.artefact.target_names.index(name)] += offset
    return positions


def _list_placed(session: Session) -> set[str]:
    """Return the names of the targets that have readings or certified positions."""
    certified = {t.name for t in session.artefact.targets if t.position_mm is not None}
    return certified | {session.artefact.target_names[k] for k in np.unique(session.target)}


def _select_lengths(session: Session, every_length: bool) -> list[Distance]:
    lengths = session.artefact.distances
    if every_length or not lengths:
        return lengths
    placed = _list_placed(session)
    return [length for length in lengths if placed.issuperset(length.between)]


def _make_distances(
    sessions: Sequence[Session], first_target: I64, every_length: bool
) -> Distances:
    entries = [
        (
            [first + s.artefact.target_names.index(name) for name in distance.between],
            distance,
            (s.artefact.name, distance),
        )
        for s, first in zip(sessions, first_target, strict=False)
        for distance in _select_lengths(s, every_length)
    ]
    return Distances(
        between=np.array([between for between, _, _ in entries], dtype=np.int64).reshape(-1, 2),
        length_mm=np.array([distance.length_mm for _, distance, _ in entries]),
        standard_uncertainty_mm=np.array([d.standard_uncertainty_mm for _, d, _ in entries]),
        certificate=_number_equal([entry for _, _, entry in entries]),
    )

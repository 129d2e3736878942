"""A session: a folder of measured data, read strictly.

`session.toml` names the arm and the artefact; `readings.csv` (or `readings.parquet`) has one row
per reading. Anything that does not fit is refused with file, row, column, found and expected.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.data.in_order import read_ahead
from armd.compensation.data.sessions.columns import (
    LikeRadians,
    MemoryOrder,
    list_number_columns,
    read_angles,
    read_approaches,
    read_rates,
    read_times,
    read_truths,
)
from armd.compensation.data.sessions.files import READINGS, check_is_session, find_readings
from armd.compensation.data.sessions.format import Artefact, SessionFile
from armd.compensation.data.sessions.orientations import read_orientations
from armd.compensation.data.soundness.temperature_columns import TemperatureColumns
from armd.compensation.data.soundness.turns import (
    AngleRange,
    describe_turns,
    fold_turns,
    report_open_turns,
)
from armd.compensation.data.tables.pieces import read_pieces
from armd.compensation.data.tables.readings import Readings, describe_row, load_readings
from armd.compensation.model.arm import Arm
from armd.compensation.model.state import States
from armd.errors import BadInput
from armd.files.inputs import open_input
from armd.files.schema import load_toml
from armd.printable import to_printable
from armd.terminal.suggest import suggest_names

TEXTS = ["placement", "target", "reflector"]
#: The memory order of a piece's arrays; operations on whole columns are several times faster in it.
PIECES_ORDER: MemoryOrder = "F"


@dataclass(frozen=True, kw_only=True)
class Session:
    """Checked readings of one arm on one artefact; arrays have one row per reading."""

    path: Path
    name: str
    arm: str
    started_unix_s: float
    artefact: Artefact
    states: States
    placement: I64  # (n,) index into placement_names
    placement_names: list[str]
    target: I64  # (n,) index into artefact.targets
    truth_mm: F64  # (n, 3) in the placement's frame; NaN where the target's is used
    artefact_c: F64  # (n,) °C, NaN missing
    unused_columns: list[str]
    row: I64  # (n,) of the table, from 0
    lost: tuple[str, ...] = ()  # stuck or silent sensors; their values come from the others
    lost_links: tuple[int, ...] = ()  # links (from 1) that depend on such a sensor
    operator: str | None = None
    artefact_before_c: float = np.nan  # of a piece: the last artefact_c in those before it
    remarks: tuple[str, ...] = ()  # sentences: values that were read and are not used as they are
    digest: Callable[[], str] | None = None  # of a session in memory: its fingerprint
    reflector: I64 | None = None  # (n,) index into reflector_names; None: arm.toml's tip
    reflector_names: tuple[str, ...] = ()
    turn: F64 | None = None  # (n, 3, 3) of the measured body in the placement's frame; NaN missing
    offset_mm: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)  # if given

    @property
    def n(self) -> int:
        return len(self.target)

    @property
    def artefact_rise_k(self) -> F64:
        """The artefact's temperature above its reference (n,) K; 0 if no reading has it.

        People read it now and then. So a reading without it has the last one before it in the
        table; those before the first have the first. The reference temperature would be that of
        another artefact.
        """
        rise = self.artefact_c - self.artefact.reference_temperature_c
        finite = np.flatnonzero(np.isfinite(rise))
        before = self.artefact_before_c - self.artefact.reference_temperature_c
        if not len(finite):
            return np.full(self.n, np.nan_to_num(before))
        last = np.searchsorted(finite, np.arange(self.n), side="right") - 1
        filled = rise[finite[np.maximum(last, 0)]]
        if np.isfinite(before):
            filled[last < 0] = before
        return filled

    def rows(self, chosen: Mask | I64) -> Session:
        """Return the session with the chosen rows only."""
        return replace(
            self,
            states=self.states.rows(chosen),
            placement=self.placement[chosen],
            target=self.target[chosen],
            truth_mm=self.truth_mm[chosen],
            artefact_c=self.artefact_c[chosen],
            row=self.row[chosen],
            reflector=None if self.reflector is None else self.reflector[chosen],
            turn=None if self.turn is None else self.turn[chosen],
        )

    def row_in_words(self, i: int) -> str:
        """Describe where a reading is: the table in the session's folder, row and line."""
        csv, parquet = READINGS
        table = parquet if (self.path / parquet).exists() else csv
        return f"{self.name}/{table} {describe_row(Path(table), int(self.row[i]))}"

    def fingerprint(self) -> str:
        """Return the SHA-256 over session.toml and the readings, as they are on the disk now.

        A session in memory is hashed as it would be written.
        """
        if self.digest is not None:
            return self.digest()
        digest = hashlib.sha256()
        for name in ("session.toml", *READINGS):
            file = self.path / name
            if file.exists():
                digest.update(f"{name}\0{file.stat().st_size}\0".encode())
                with open_input(file) as content:
                    while block := content.read(1 << 20):
                        digest.update(block)
        return digest.hexdigest()


def make_distinct_names(sessions: Sequence[Session]) -> list[str]:
    """Return the folders' names; whole paths where two folders share one."""
    names = [session.name for session in sessions]
    distinct = len(set(names)) == len(names)
    return names if distinct else [str(session.path) for session in sessions]


def load_sessions(
    paths: Sequence[str | Path], arm: Arm, besides: Sequence[Session] = ()
) -> list[Session]:
    """Read session folders, each of them once and none of those *besides*.

    Duplicate readings look better known than they are, and held-out ones that were fitted prove
    nothing. Raises `BadInput`.
    """
    check_once(paths, besides)
    return report_turns([load_session(path, arm) for path in paths], arm, besides)


def report_turns(
    sessions: Sequence[Session], arm: Arm, besides: Sequence[Session] = ()
) -> list[Session]:
    """Return the sessions with remarks on joints whose limits do not decide the turn."""
    ranges = [
        AngleRange.from_angles(session.name, session.states.q) for session in (*sessions, *besides)
    ]
    return [
        replace(session, remarks=(*session.remarks, *remarks))
        for session, remarks in zip(sessions, report_open_turns(ranges, arm), strict=False)
    ]


def check_once(paths: Sequence[str | Path], besides: Sequence[Session] = ()) -> None:
    """Raise `BadInput` for a session that is given twice, or that is one of *besides*."""
    real_paths = {os.path.realpath(session.path) for session in besides}
    for path in map(Path, paths):
        real = os.path.realpath(path)  # also for a link that leads back to itself
        if real in real_paths:
            raise BadInput(path, "the session", "given twice", "every session once")
        real_paths.add(real)


def load_session(path: str | Path, arm: Arm, file: SessionFile | None = None) -> Session:
    """Read the session folder *path*, measured with *arm*.

    *file* is its session.toml, if that has been read. Raises `BadInput` naming file, row, column,
    found and expected.
    """
    folder = Path(path)
    file = _session_file(folder, arm, file)
    readings = load_readings(find_readings(folder), list_number_columns(arm), TEXTS)
    return assemble_session(folder, file, arm, readings)


def assemble_session(
    place: Path,
    file: SessionFile,
    arm: Arm,
    readings: Readings,
    *,
    digest: Callable[[], str] | None = None,
) -> Session:
    """Make the session of *readings* that are in memory, called *place*; raises `BadInput`."""
    like_radians = LikeRadians(arm, file.angle_unit)
    session = _session(place, file, arm, readings, {}, TemperatureColumns(arm))
    like_radians.take(readings, session.states.q)
    like_radians.judge()
    return replace(session, digest=digest)


def load_session_pieces(path: str | Path, arm: Arm) -> Iterator[Session]:
    """Read the session of `load_session` in consecutive pieces.

    Each piece names the placements that have occurred so far. Raises `BadInput` like
    `load_session`.
    """
    folder = Path(path)
    file = _session_file(folder, arm)
    like_radians = LikeRadians(arm, file.angle_unit)
    placements: dict[str, int] = {}
    dated: bool | None = None
    artefact_c = np.nan
    celsius = TemperatureColumns(arm, PIECES_ORDER)
    pieces = read_pieces(find_readings(folder), list_number_columns(arm), TEXTS)
    for readings in read_ahead(pieces):
        piece = _session(folder, file, arm, readings, placements, celsius, PIECES_ORDER)
        file = file.model_copy(update={"artefact": piece.artefact})
        piece = replace(piece, artefact_before_c=artefact_c)
        known_c = piece.artefact_c[np.isfinite(piece.artefact_c)]
        artefact_c = float(known_c[-1]) if len(known_c) else artefact_c
        like_radians.take(readings, piece.states.q)
        now = not np.isnan(piece.states.time_s).any()
        if dated not in (None, now):
            row = 0 if dated else -readings.first_row
            raise readings.fault(row, "time_s", "nothing", "a number")
        dated = now
        yield piece
    like_radians.judge()


def _session_file(folder: Path, arm: Arm, file: SessionFile | None = None) -> SessionFile:
    check_is_session(folder)
    file = file or load_toml(folder / "session.toml", SessionFile)
    check_arm(folder / "session.toml", file, arm)
    return file


def check_arm(place: Path, file: SessionFile, arm: Arm) -> None:
    """Raise `BadInput`, which names *place*, if the session is another arm's."""
    if file.arm != arm.serial_number:
        expected = f"{arm.serial_number!r}, as in arm.toml"
        raise BadInput(place, "arm", repr(file.arm), expected)


def _session(
    folder: Path,
    file: SessionFile,
    arm: Arm,
    readings: Readings,
    placements: dict[str, int],
    celsius: TemperatureColumns,
    order: MemoryOrder = "C",
) -> Session:
    """Make a session from readings.

    *placements* maps names of earlier rows to their numbers; new names are added to it. *celsius*
    holds the temperatures of earlier rows. *order* is that of the angles in memory.
    """
    numbers = list_number_columns(arm)
    codes, names = readings.names("placement")
    numbered = [placements.setdefault(name, len(placements)) for name in names]
    placement = np.array(numbered, dtype=np.int64)[codes]
    targets = readings.names("target")
    artefact = file.artefact.with_documented(targets[1])
    time_s = read_times(readings)
    q, turns = fold_turns(read_angles(readings, arm, file.angle_unit, order=order), arm)
    rate = read_rates(readings, arm.n_joints)
    name = to_printable(folder.resolve().name)
    reflector, reflectors = readings.names("reflector") if readings.has("reflector") else (None, [])
    temperature_c, artefact_c, remarks = celsius.take(readings, time_s, name)
    return Session(
        path=folder,
        name=name,
        arm=file.arm,
        started_unix_s=file.started.timestamp(),
        artefact=artefact,
        states=States(
            q=q,
            rate=rate,
            temperature_c=temperature_c,
            time_s=file.started.timestamp() + time_s,
            approach=read_approaches(readings, arm, q, rate),
            series=np.zeros(readings.n, dtype=np.int64),
        ),
        placement=placement,
        placement_names=list(placements),
        target=_targets(readings, *targets, artefact),
        truth_mm=read_truths(readings),
        artefact_c=artefact_c,
        unused_columns=[name for name in readings.header if name not in (*numbers, *TEXTS)],
        row=readings.first_row + np.arange(readings.n),
        operator=file.operator,
        remarks=(*remarks, *describe_turns(name, turns)),
        turn=read_orientations(readings),
        reflector=reflector,
        reflector_names=tuple(reflectors),
        offset_mm={entry.name: entry.offset_mm for entry in file.reflectors},
    )


def _targets(readings: Readings, codes: I64, names: list[str], artefact: Artefact) -> I64:
    index_of = {name: i for i, name in enumerate(artefact.target_names)}
    for code, name in enumerate(names):
        if name not in index_of:
            row = int(np.argmax(codes == code))
            expected = f"a target of the artefact{suggest_names(name, index_of)}"
            if not index_of:
                expected = "a [[artefact.target]] of this name in session.toml"
            raise readings.fault(row, "target", repr(name), expected)
    return np.array([index_of[name] for name in names], dtype=np.int64)[codes]

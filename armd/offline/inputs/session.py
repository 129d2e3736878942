"""`read_session` and `make_session`: measured readings, from a folder or a table in memory."""

from __future__ import annotations

import datetime
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armd.compensation.data.sessions.format import AngleUnit, ArtefactFile, SessionFile
from armd.compensation.data.sessions.session import Session as StoredSession
from armd.compensation.data.sessions.session import check_once, report_turns
from armd.compensation.model.arm import Arm
from armd.errors import BadInput
from armd.files.inputs import MOST_TOML_BYTES, read_input
from armd.files.schema import decode_toml, validate
from armd.offline.arm_model import ArmModel, PathText, resolve_arm
from armd.offline.inputs.arrow_input import to_arrow_table
from armd.offline.inputs.session_source import FolderSource, SessionSource, TableSource
from armd.offline.results.display import Displayed, Facts

#: The start of a session in memory, unless the caller gives it.
EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
#: The name of a session in memory, in messages and results.
IN_MEMORY = "session"


class Session(Displayed):
    """Readings of one arm on one artefact. `read_session` and `make_session` make it.

    The readings of a folder are read, and checked against the arm, when they are first used with
    one. They are kept until the session is used with another arm.
    """

    def __init__(self, source: SessionSource) -> None:
        self._source = source
        self._loaded: tuple[str, StoredSession] | None = None

    @property
    def path(self) -> Path | None:
        """The folder; None for a session in memory."""
        return self._source.path

    @property
    def name(self) -> str:
        """The folder's name; `session` for a session in memory."""
        return self.path.resolve().name if self.path is not None else IN_MEMORY

    @property
    def arm(self) -> str:
        """The serial number of the measured arm."""
        return self._source.file.arm

    @property
    def started(self) -> datetime.datetime:
        """The instant of `time_s = 0`."""
        return self._source.file.started

    @property
    def angle_unit(self) -> AngleUnit:
        """The unit of the columns q1 … qN: `rad`, `deg` or `count`."""
        return self._source.file.angle_unit

    @property
    def artefact(self) -> dict[str, Any]:
        """The measured artefact, as in session.toml."""
        return self._source.file.artefact.model_dump(by_alias=True, exclude_defaults=True)

    @property
    def readings(self) -> Any:
        """All columns of the readings, unchecked: a `pyarrow.Table`, one row a reading."""
        return self._source.readings()

    def save(self, folder: PathText) -> None:
        """Write the session's folder: session.toml, and readings.csv or readings.parquet.

        Each file appears completely or not at all. Raises `armd.BadInput` where nothing can be
        written.
        """
        self._source.save(Path(folder))

    def load(self, arm: Arm, place: Path) -> StoredSession:
        """Return the readings in the form of armd's own functions. Not public.

        *place*: their name in messages.
        """
        key = f"{place}\0{arm.model_dump_json()}"
        if self._loaded is None or self._loaded[0] != key:
            self._loaded = key, self._source.load(arm, place)
        return self._loaded[1]

    def _describe(self) -> tuple[str, Facts]:
        file = self._source.file
        facts = [
            ("arm", file.arm),
            ("started", file.started.isoformat()),
            ("artefact", f"{file.artefact.name}, {len(file.artefact.target_names)} targets"),
            ("angles", file.angle_unit),
        ]
        if self.path is None:
            table = self.readings
            facts.append(("readings", str(table.num_rows)))
            facts.append(("columns", ", ".join(table.column_names)))
        return f"Session {self.path or IN_MEMORY}", facts


Sessions = Session | PathText | Iterable[Session | PathText]


def read_session(folder: PathText) -> Session:
    """Read a session's folder: session.toml now, the readings when they are first used.

    Raises `armd.BadInput` for a folder that is no session, or an invalid session.toml. The function
    that takes the session and the arm raises faults of the readings.

    >>> session = armd.read_session("measured/T20")
    >>> session.arm
    'SIM-0001'
    """
    return Session(FolderSource(Path(folder)))


def make_session(
    table: Any,
    arm: ArmModel | PathText,
    *,
    artefact: Mapping[str, Any] | PathText | None = None,
    angle_unit: AngleUnit = "rad",
    started: datetime.datetime | str | None = None,
) -> Session:
    """Return a session of readings in memory.

    *table*: a pandas or polars data frame, an Arrow table or record batch, any object with
    `__arrow_c_stream__`, or a dict of arrays (n,). Its columns are those of readings.csv: `time_s`
    in s, `placement`, `target`, `q1` … `qN` in *angle_unit* (`rad`, `deg` or `count`), and the
    optional ones: `w1` … `wN` in rad/s, a column for each sensor in °C, `artefact_c`, `approach_x`
    …, `x_mm` …, `qx` … or `rx_deg` …, `reflector`; NaN or null is missing. *artefact*: a dict as
    the table `[artefact]` of session.toml, or the path of a file that has one; None: every target
    is an unknown fixed point. *started*: the instant of `time_s = 0`, a datetime or ISO text with
    its offset from UTC; None: 1970-01-01T00:00:00Z.

    Raises `armd.BadInput` naming row and column. The function that takes the session raises faults
    of single readings.

    >>> columns = {"time_s": np.arange(3.0), "placement": ["P1"] * 3, "target": ["S1"] * 3}
    >>> columns |= {f"q{k}": np.linspace(0, 0.1, 3) for k in range(1, 7)}
    >>> armd.make_session(columns, "measured/arm.toml").readings.num_rows
    3
    """
    model = resolve_arm(arm)
    readings = to_arrow_table(table, IN_MEMORY)
    start = EPOCH if started is None else started
    content = {
        "schema": "armd.session/1",
        "arm": model.serial_number,
        "started": start.isoformat() if isinstance(start, datetime.datetime) else start,
        "angle_unit": angle_unit,
        "artefact": _unknown_points(readings)
        if artefact is None
        else to_artefact_content(artefact),
    }
    file = validate(IN_MEMORY, content, SessionFile)
    source = TableSource(file, readings)
    source.load(model.content, Path(IN_MEMORY))  # refuses invalid readings now
    return Session(source)


def to_artefact_content(artefact: Mapping[str, Any] | PathText) -> dict[str, Any]:
    """Return the content of `[artefact]`. Not public."""
    if isinstance(artefact, Mapping):
        table: dict[str, Any] = _to_builtin(artefact)
        return table
    path = Path(artefact)
    data = decode_toml(path, read_input(path, MOST_TOML_BYTES))
    is_session = data.get("schema") == "armd.session/1"
    model: type[SessionFile | ArtefactFile] = SessionFile if is_session else ArtefactFile
    content: dict[str, Any] = validate(path, data, model).artefact.model_dump(
        mode="json", by_alias=True, exclude_defaults=True
    )
    return content


def _unknown_points(readings: Any) -> dict[str, Any]:
    """Return an artefact whose targets have names, but no known positions."""
    targets = readings["target"].to_pylist() if "target" in readings.column_names else []
    names = dict.fromkeys(str(name) for name in targets if name is not None)
    return {"name": "unknown points", "target": [{"name": name} for name in names if name]}


def _to_builtin(value: Any) -> Any:
    """Return data without numpy's types, for the check."""
    match value:
        case Mapping():
            return {str(key): _to_builtin(below) for key, below in value.items()}
        case np.ndarray() | np.generic():
            return value.tolist()
        case list() | tuple():
            return [_to_builtin(below) for below in value]
    return value


def resolve_sessions(sessions: Sessions) -> list[Session]:
    """Return the sessions, read where they are paths; a single one counts as a list."""
    single = isinstance(sessions, Session | str | os.PathLike)
    listed: list[Session | PathText] = [sessions] if single else list(sessions)  # type: ignore[list-item, arg-type]
    if not listed:
        raise BadInput("sessions", "the list", "no session", "one at least")
    return [
        session if isinstance(session, Session) else read_session(session) for session in listed
    ]


def load_sessions(
    sessions: Sequence[Session], arm: Arm, holdout: Sequence[Session] = ()
) -> tuple[list[StoredSession], list[StoredSession]]:
    """Read *sessions* and *holdout* for *arm*, each session once; raises `BadInput`."""
    every = [*sessions, *holdout]
    places, counted = list[Path](), 0
    for i, session in enumerate(every):
        if session.path is not None:
            places.append(session.path)
            continue
        if any(session is earlier_session for earlier_session in every[:i]):
            raise BadInput(session.name, "the session", "given twice", "every session once")
        counted += 1
        places.append(Path(IN_MEMORY if counted == 1 else f"{IN_MEMORY}-{counted}"))
    check_once([session.path for session in sessions if session.path is not None])
    first = report_turns(
        [session.load(arm, place) for session, place in zip(sessions, places, strict=False)], arm
    )
    if not holdout:
        return first, []
    fitted = [
        stored for session, stored in zip(sessions, first, strict=True) if session.path is not None
    ]
    check_once([session.path for session in holdout if session.path is not None], fitted)
    rest = [
        session.load(arm, place)
        for session, place in zip(holdout, places[len(sessions) :], strict=True)
    ]
    return first, report_turns(rest, arm, first)

"""Read measurements to export: JSON lines, a table, a recording, or a running daemon."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from armd import Arm, keys
from armd.arrays import Vector
from armd.compensation.data.foreign.points import read_points
from armd.compensation.data.foreign.table import TABLES
from armd.compensation.data.sessions.columns import APPROACH
from armd.daemon.files.measurement_log import SUFFIX, list_log_files, parse_serial
from armd.daemon.files.recorder import TOPICS
from armd.drivers.replay.recording import INFO_ATTACHMENT, Recording
from armd.errors import BadInput
from armd.files.inputs import open_input
from armd.files.schema import KeyTwice, decode_json_text, load_json_data
from armd.received import names_arm_and_tips

RECORDING = ".mcap"
TABLE = ".csv"
#: Columns of every table; the joints' angles and rates and the sensors' temperatures follow.
COLUMNS = (
    "stamp_ns", "x_mm", "y_mm", "z_mm", "i", "j", "k", "u_x_mm", "u_y_mm", "u_z_mm",
    "sd_x_mm", "sd_y_mm", "sd_z_mm", "count", "duration_s", "flags", "flag_names", "seq",
    "buttons", "trigger", "tip", "calibration", "tip_x_mm", "tip_y_mm", "tip_z_mm", "tip_radius_mm",
    "serial",
)  # fmt: skip
#: Prefix for a sensor whose name is also the name of a column or of a joint's column.
CLASH = "temperature_"


def _has_variances(covariance: tuple[float, ...]) -> tuple[float, ...]:
    if min(covariance[0], covariance[3], covariance[5]) < 0.0:
        raise ValueError("a negative variance")
    return covariance


Covariance = Annotated[
    tuple[float, float, float, float, float, float], AfterValidator(_has_variances)
]
"""xx xy xz yy yz zz, mm²."""

Bits = Annotated[int, Field(ge=0, lt=1 << 32)]


def _is_whole(text: str) -> str:
    text.encode()  # JSON may hold half a surrogate pair, which raises a `ValueError` here
    return text


WholeText = Annotated[str, AfterValidator(_is_whole)]


class MeasurementLine(BaseModel):
    """One measurement as on `armd/<serial>/measurement`, with unknown keys of later versions."""

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)

    seq: Annotated[int, Field(ge=0, lt=1 << 64)]
    stamp_ns: Annotated[int, Field(ge=-(1 << 63), lt=1 << 63)]
    position_mm: Vector | None
    standard_deviation_mm: Vector | None = None
    covariance_mm2: Covariance | None = None
    orientation: tuple[float, float, float, float] | None = None
    approach: Vector | None = None
    angles_rad: list[float] | None = None
    rates_rad_s: list[float] | None = None
    temperatures_c: dict[WholeText, float | None] = {}
    count: int = 1
    duration_s: float = 0.0
    flags: Bits
    flag_names: list[WholeText] = []
    buttons: Bits = 0
    trigger: WholeText = ""
    tip: WholeText | None = None
    #: Offset in the last joint's frame and the ball's radius then; older lines lack both.
    tip_offset_mm: Vector | None = None
    tip_radius_mm: float | None = None
    calibration: WholeText | None = None
    serial: WholeText | None = None  # of the arm; older lines lack it


@dataclass
class Measurements:
    """The measurements that were read, the oldest first."""

    measurements: list[MeasurementLine] = field(default_factory=list)
    serial: str = ""
    """Empty: the source does not say whose they are."""
    info: dict[str, Any] | None = None
    """The arm's, where the source has it."""
    left_out: list[str] = field(default_factory=list)
    """What a kill or a power cut took from the source: a sentence each."""


def from_path(path: Path) -> Measurements:
    """Read measurements from a file or a folder; raises `BadInput`.

    *path* is a file of JSON lines, a measurement log's folder, a recording, a table that `armd
    export` wrote, or a table of points.
    """
    if path.is_dir():
        files = list_log_files(path)
        if not files:
            raise BadInput(path, "the folder", f"no *{SUFFIX}", "a measurement log")
        return _from_lines(files, parse_serial(path))
    if path.suffix == RECORDING:
        return _from_recording(path)
    if path.suffix == TABLE:
        return _from_table(path)
    if path.suffix.lower() in TABLES:
        return Measurements(_read_points(path))
    if path.suffix != SUFFIX:
        expected = f"{SUFFIX}, {RECORDING} or {TABLE}"
        raise BadInput(path, "the suffix", repr(path.suffix), expected)
    return _from_lines([path], "")


def from_arm(arm: Arm) -> Measurements:
    """Ask a running daemon for its past measurements; it keeps the last thousand."""
    source_key = f"armd/{arm.serial}/{keys.MEASUREMENT}"
    measurements = [
        _measurement(source_key, "an answer", line) for line in arm.past(keys.MEASUREMENT)
    ]
    return Measurements(_in_order(measurements), arm.serial, arm.info())


def _from_lines(files: Iterable[Path], serial: str) -> Measurements:
    result = Measurements(serial=serial)
    for path in files:
        for number, line in _lines(path):
            try:
                result.measurements.append(
                    _measurement(path, f"line {number}", decode_json_text(line))
                )
            except KeyTwice as error:
                location = f"line {number}: {error.key}"
                raise BadInput(path, location, error.description, "it once") from error
            except (ValueError, RecursionError) as error:
                # After a crash the log ends the torn line and continues: it may be anywhere.
                if not _is_torn(line):
                    expected = "a measurement as JSON"
                    raise BadInput(path, f"line {number}", str(error), expected) from error
                result.left_out.append(f"{path}: line {number}: cut short, left out")
    result.measurements = _in_order(result.measurements)
    serials = {m.serial for m in result.measurements}
    if serials and None not in serials:  # a log's folder may have been copied under another name
        result.serial = str(serials.pop()) if len(serials) == 1 else ""
    return result


def _is_torn(line: bytes) -> bool:
    """Return whether an unreadable line may be a measurement that was cut short.

    It then begins with `{`, or consists of the zeros that some file systems leave after a power
    cut.
    """
    return line.startswith(b"{") or not line.strip(b"\0")


def _lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the number (from 1) and the content of each line that is not empty."""
    with open_input(path) as file:
        for number, line in enumerate(file, 1):
            if line.strip():
                yield number, line.strip()


def _from_recording(path: Path) -> Measurements:
    recording = Recording(path)
    topic = TOPICS[keys.MEASUREMENT]
    measurements = _in_order(
        _measurement(path, topic, load_json_data(path, message.data))
        for message in recording.messages({topic})
    )
    info = read_info(recording)
    serial = info["arm"]["serial_number"]
    left_out = [] if recording.missing is None else [recording.missing]
    return Measurements(measurements, serial, info, left_out)


def read_info(recording: Recording) -> dict[str, Any]:
    """Return the recorded daemon's `info`.

    Raises `BadInput` where it does not name the arm and its tips. (A replay reads more of it, and
    checks that itself.)
    """
    if not names_arm_and_tips(recording.info):
        location = f"{recording.path}: {INFO_ATTACHMENT}"
        problem, expected = (
            "no serial number, or tips of another form",
            "what `armd record` writes there",
        )
        raise BadInput(location, "arm, configuration.tips", problem, expected)
    return recording.info


def _from_table(path: Path) -> Measurements:
    """Read a table that `tables.as_csv` wrote, or a table of points alone.

    Covariances have only their diagonal; the table does not store the rest.
    """
    with open_input(path) as file:
        rows = csv.DictReader(io.TextIOWrapper(file, encoding="utf-8-sig", newline=""))
        try:
            names = rows.fieldnames or []
            if not {"stamp_ns", "seq"} & set(names):
                return Measurements(_read_points(path))
            for name in ("stamp_ns", "x_mm", "y_mm", "z_mm", "seq", "flags"):
                if name not in names:
                    expected = "a table of `armd export`"
                    raise BadInput(path, f"column {name}", "nothing", expected)
            sensors = _sensor_columns(path, names)
            measurements = [
                _measurement(path, f"row {n}", _convert_row(row, sensors))
                for n, row in enumerate(rows, 1)
            ]
        except (ValueError, OverflowError, csv.Error) as error:
            raise BadInput(path, "the table", str(error), "a table of `armd export`") from error
    return Measurements(_in_order(measurements))


def _read_points(path: Path) -> list[MeasurementLine]:
    """Read a table of points alone, in its order; nothing else is known of them."""
    positions = read_points(path).position_mm.tolist()
    return [
        MeasurementLine(seq=number, stamp_ns=number, position_mm=(x, y, z), flags=0)
        for number, (x, y, z) in enumerate(positions)
    ]


def _joint_columns(names: Container[str], letter: str) -> list[str]:
    """Return the columns of all joints with this letter, from 1 on."""
    numbered = (f"{letter}{k}" for k in itertools.count(1))
    return list(itertools.takewhile(names.__contains__, numbered))


def _sensor_columns(path: Path, names: Sequence[str]) -> list[str]:
    """Return the sensors' columns, which follow the last column with a known name.

    Raises `BadInput` for an unknown column before that one.
    """
    joints = [*_joint_columns(names, "q"), *_joint_columns(names, "w")]
    column_names = {*COLUMNS, *APPROACH, *joints}
    last = max(i for i, name in enumerate(names) if name in column_names)
    for name in names[:last]:
        if name and name not in column_names:
            expected = f"a column of `armd export`, or a sensor's after {names[last]}"
            raise BadInput(path, "the header", f"column {name!r}", expected)
    return [name for name in names[last + 1 :] if name]


def _convert_row(row: dict[str, str], sensors: Sequence[str]) -> dict[str, Any]:
    """Convert a row of a table to the data of a measurement; temperatures are in *sensors*.

    Raises `ValueError` for text that is not a number, or for more or fewer cells than the header
    has.
    """
    if None in row or None in row.values():  # csv's marks for too many and for too few cells
        raise ValueError("a row with more or fewer cells than the header")

    def numbers(names: Iterable[str]) -> list[float] | None:
        """Return the numbers in these columns; None unless all are known."""
        texts = [row.get(name) or "" for name in names]
        return [float(text) for text in texts] if texts and all(texts) else None

    deviation = numbers(f"u_{axis}_mm" for axis in "xyz")
    texts_c = {name.removeprefix(CLASH): row[name] for name in sensors}
    measurement: dict[str, Any] = {
        "position_mm": numbers(f"{axis}_mm" for axis in "xyz"),
        "standard_deviation_mm": numbers(f"sd_{axis}_mm" for axis in "xyz"),
        "covariance_mm2": deviation
        and [deviation[0] ** 2, 0.0, 0.0, deviation[1] ** 2, 0.0, deviation[2] ** 2],
        "approach": numbers(APPROACH),
        "tip_offset_mm": numbers(f"tip_{axis}_mm" for axis in "xyz"),
        "tip_radius_mm": float(row["tip_radius_mm"]) if row.get("tip_radius_mm") else None,
        "angles_rad": numbers(_joint_columns(row, "q")),
        "rates_rad_s": numbers(_joint_columns(row, "w")),
        "temperatures_c": {name: float(text) if text else None for name, text in texts_c.items()},
        "flag_names": (row.get("flag_names") or "").split(),
        "tip": row.get("tip") or None,
        "calibration": row.get("calibration") or None,
        "serial": row.get("serial") or None,
        "trigger": row.get("trigger") or "",
        **{name: int(row[name]) for name in ("stamp_ns", "seq", "flags")},
        **{name: int(row[name]) for name in ("count", "buttons") if row.get(name)},
    }
    if row.get("duration_s"):
        measurement["duration_s"] = float(row["duration_s"])
    return measurement


def _measurement(path: str | Path, location: str, data: Any) -> MeasurementLine:
    try:
        return MeasurementLine.model_validate(data)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(map(str, fault["loc"])) or "the line"
        problem = "nothing" if fault["type"] == "missing" else repr(fault["input"])[:60]
        raise BadInput(path, f"{location}: {key}", problem, fault["msg"]) from error


def _in_order(measurements: Iterable[MeasurementLine]) -> list[MeasurementLine]:
    """Sort measurements by time, and keep one of those that a source has twice."""
    by_time = {(m.stamp_ns, m.seq): m for m in measurements}
    return [by_time[key] for key in sorted(by_time)]

"""`Corrector`: adds corrected points to tables of readings, in any process."""

from __future__ import annotations

import datetime
import json
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from armd.arrays import F64
from armd.compensation.data.correction.correction import Corrector as FileCorrector
from armd.compensation.data.correction.correction import Taken
from armd.compensation.data.correction.point_columns import COLUMNS, make_point_columns
from armd.compensation.data.in_order import keep_freed_memory, run_in_order
from armd.compensation.data.sessions.format import AngleUnit, check_instant
from armd.compensation.data.tables.header import check_header
from armd.compensation.data.tables.readings import Readings, convert_columns
from armd.compensation.data.tables.recorded import (
    RECORDED_TYPES,
    STAMP,
    drop_published,
    is_recorded,
)
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration as Content
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.model.slow_factors import SlowFactor
from armd.errors import BadInput
from armd.files.schema import parse_json
from armd.offline.arm_model import ArmModel, PathText, resolve_arm
from armd.offline.calibration import Calibration, resolve_calibration
from armd.offline.inputs.arrow_input import to_arrow_table
from armd.offline.results.display import Displayed, Facts

#: Rows processed at once: few enough for a processor's cache, many enough that the overhead of the
#: calls is small. A table is in memory anyway; files are read in smaller pieces.
PIECE_ROWS = 1 << 15
#: The name of the table in messages.
TABLE = "table"
#: After this many time constants, an earlier temperature has no effect in a double: e^-40.
TIME_CONSTANTS = 40.0
UNITS = ("rad", "deg", "count")


class Corrector(Displayed):
    """Corrects tables of readings, as `armd correct` corrects a file of exactly these rows.

    *arm*, *calibration*: as in `Model`. *angle_unit*: of the columns q1 … qN. *started*: the
    instant of `time_s = 0`, a datetime or ISO text with its offset from UTC; needed where the
    calibration has terms that depend on the date. *uncertainty*: with the columns u_x_mm, u_y_mm,
    u_z_mm.

    A call takes a `pyarrow` record batch or table (or any object with `__arrow_c_stream__`) with
    columns q1 … qN and, where the calibration needs them, the sensors' columns in °C, w1 … wN,
    approach_x …, time_s. It returns the same type, of pyarrow, with `x_mm, y_mm, z_mm, u_x_mm,
    u_y_mm, u_z_mm, flags` appended: mm, standard uncertainties (k = 1), flags of `armd.Flag`. Rows
    must be in the order of time where temperatures are missing or lag. A call remembers nothing of
    earlier calls. So put the rows that `lead_in` returns before a part of a longer table, and drop
    them afterwards. A corrector can be pickled, and reads no file after it was made.

    Raises `armd.BadInput` for files that do not fit together, and for a table that `armd correct`
    would refuse.

    >>> corrector = armd.Corrector("measured/arm.toml", "calibration.json")
    >>> table = armd.read_session("measured/T20").readings
    >>> corrector(table).column_names[-7:]
    ['x_mm', 'y_mm', 'z_mm', 'u_x_mm', 'u_y_mm', 'u_z_mm', 'flags']
    """

    def __init__(
        self,
        arm: ArmModel | PathText,
        calibration: Calibration | PathText | None = None,
        *,
        angle_unit: AngleUnit = "rad",
        started: datetime.datetime | str | None = None,
        uncertainty: bool = True,
    ) -> None:
        model = resolve_arm(arm)
        if angle_unit not in UNITS:
            raise BadInput("Corrector", "angle_unit", repr(angle_unit), f"one of {UNITS}")
        self._arm: Arm = model.content
        self._calibration = resolve_calibration(calibration, model)
        self._unit: AngleUnit = angle_unit
        self._started_unix_s = None if started is None else parse_instant("started", started)
        self._uncertainty = uncertainty
        #: sentences on the last table: values that were read and not used as they are
        self.remarks: list[str] = []

    @property
    def lead_in_s(self) -> float:
        """The seconds of earlier rows after which every lag is as in the whole table."""
        terms = self._calibration.content.terms if self._calibration else []
        lags = [
            lag_s
            for term in terms
            for factor in term.basis
            if isinstance(factor, SlowFactor)
            for _, lag_s in factor.means
        ]
        return TIME_CONSTANTS * max(lags, default=0.0)

    def lead_in(self, table: Any) -> pa.Table:
        """Return the last rows of *table* that rows which follow it depend on.

        They cover `lead_in_s`, and begin at the latest at each sensor's last value, which is held
        until the next one; there is at least one row. Put them before the following rows and drop
        their results. Raises `BadInput` where lags need the time and the table has none.
        """
        rows = to_arrow_table(table, TABLE)
        firsts = [max(rows.num_rows - 1, 0)]
        for name in self._arm.sensors:
            if name in rows.column_names:
                rows_with_value = np.flatnonzero(~np.isnan(_numbers(rows, name)))
                firsts += rows_with_value[-1:].tolist()
        if self.lead_in_s and rows.num_rows:
            is_stamped = is_recorded(rows.column_names)
            time_s = _numbers(rows, STAMP) * 1e-9 if is_stamped else _numbers(rows, "time_s")
            recent = time_s >= time_s[-1] - self.lead_in_s
            firsts.append(int(np.argmax(recent)))
        return rows.slice(min(firsts))

    def __call__(self, table: Any) -> Any:
        readings = to_arrow_table(table, TABLE)
        path, header = Path(TABLE), list(readings.column_names)
        check_header(path, header)
        added = COLUMNS if self._uncertainty else [*COLUMNS[:3], COLUMNS[-1]]
        if not is_recorded(header) and (twice := sorted(set(added) & set(header))):
            raise BadInput(path, f"column {twice[0]}", "it already", "a table without it")
        corrector = FileCorrector(self._arm, self._calibration, self._unit, self._started_unix_s)
        numbers = convert_columns(path, readings, corrector.select_columns(header))
        readings = drop_published(readings, corrector.identity)

        def take_pieces() -> Iterator[Taken]:
            for first in range(0, readings.num_rows, PIECE_ROWS):
                rows = numbers.slice(first, PIECE_ROWS)
                yield corrector.take(Readings(path, header, rows, first))

        keep_freed_memory()

        def correct_piece(piece: Taken) -> tuple[F64, npt.NDArray[np.uint32]]:
            return corrector.correct(piece, uncertainty=self._uncertainty)

        pieces = [
            make_point_columns(*figures) for figures in run_in_order(correct_piece, take_pieces())
        ]
        corrector.ended(path)
        self.remarks = corrector.remarks
        points = pa.concat_tables(pieces) if pieces else _no_points(len(added) - 1)
        for name in added:
            readings = readings.append_column(name, points[name])
        if not isinstance(table, pa.RecordBatch):
            return readings
        arrays = [column.combine_chunks() for column in readings.columns]
        return pa.RecordBatch.from_arrays(arrays, schema=readings.schema)

    def __getstate__(self) -> dict[str, Any]:
        return {
            "arm": zlib.compress(self._arm.model_dump_json(by_alias=True).encode(), 9),
            "calibration": self._calibration and _packed(self._calibration, self._uncertainty),
            "unit": self._unit,
            "started_unix_s": self._started_unix_s,
            "uncertainty": self._uncertainty,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._arm = parse_json("arm", zlib.decompress(state["arm"]), Arm)
        self._calibration = state["calibration"] and _unpacked(*state["calibration"])
        self._unit = state["unit"]
        self._started_unix_s = state["started_unix_s"]
        self._uncertainty = state["uncertainty"]
        self.remarks = []

    def _describe(self) -> tuple[str, Facts]:
        source = self._calibration.path if self._calibration else "none: nominal geometry"
        facts = [
            ("calibration", str(source)),
            ("angles", self._unit),
            ("uncertainties", "yes" if self._uncertainty else "no"),
            ("lead-in", f"{self.lead_in_s:g} s"),
        ]
        return f"Corrector of arm {self._arm.serial_number}", facts


def parse_instant(option: str, value: datetime.datetime | str, source: str = "Corrector") -> float:
    """Return Unix seconds of a datetime or ISO 8601 text.

    Raises `BadInput`, which names *source* and *option*.
    """
    text = repr(value) if isinstance(value, str) else value.isoformat()
    try:
        instant = datetime.datetime.fromisoformat(value) if isinstance(value, str) else value
    except ValueError:
        instant = None
    if instant is None or instant.tzinfo is None:
        expected = "an instant with its offset from UTC, as 2026-03-01T09:00:00Z"
        raise BadInput(source, option, text, expected)
    try:
        return check_instant(instant).timestamp()
    except ValueError as error:
        raise BadInput(source, option, text, str(error)) from error


def _numbers(table: pa.Table, name: str) -> F64:
    """Return a column as numbers (n,), NaN where missing; raises `BadInput`."""
    types = {name: RECORDED_TYPES.get(name, pa.float64())}
    numbers = convert_columns(Path(TABLE), table, types)
    return Readings(Path(TABLE), list(table.column_names), numbers).unchecked(name)


def _no_points(figures: int) -> pa.Table:
    return make_point_columns(np.empty((0, figures)), np.empty(0, np.uint32))


def _packed(calibration: LoadedCalibration, uncertainty: bool) -> tuple[bytes, bytes, str, str]:
    """Return the parts of a calibration that a correction needs, compressed.

    They are the content and the lower triangle of the covariance; no more of it is used.
    """
    content = calibration.content.content()
    del content["provenance"]
    covariance = content.pop("covariance")
    names = content.pop("covariance_of")
    triangle = b""
    if uncertainty:
        content["covariance_of"] = names
        count = len(names)
        full = np.array(covariance, dtype="<f8").reshape(count, count)
        triangle = full[np.tril_indices(count)].tobytes()
    data = zlib.compress(json.dumps(content, separators=(",", ":")).encode(), 9)
    return data, triangle, calibration.sha256, str(calibration.path)


def _unpacked(data: bytes, triangle: bytes, sha256: str, path: str) -> LoadedCalibration:
    content = json.loads(zlib.decompress(data))
    count = len(content.get("covariance_of", []))
    full = np.zeros((count, count))
    full[np.tril_indices(count)] = np.frombuffer(triangle, "<f8")
    content["covariance"] = np.where(np.tri(count, dtype=bool), full, full.T).tolist()
    return LoadedCalibration(Content.model_validate_json(json.dumps(content)), sha256, Path(path))

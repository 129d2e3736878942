"""Tables of readings in, the same tables with corrected points out, piece by piece.

A piece holds some ten thousand rows, so that memory does not grow with the file. What lies
between rows (held temperatures, lags) is carried from piece to piece; all else is worked out on
all processors, some pieces at a time.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from armd import Flag
from armd.arrays import F64, Mask
from armd.compensation.data.in_order import in_order
from armd.compensation.data.pieces import line_pieces, open_parquet, parquet_pieces
from armd.compensation.data.point_columns import COLUMNS, make_point_columns
from armd.compensation.data.readings import (
    Readings,
    cast_columns,
    parse_csv,
    read_header,
)
from armd.compensation.data.recorded import (
    RECORDED_TYPES,
    drop_published,
    instants_s,
    is_recorded,
    published_flags,
)
from armd.compensation.data.session_columns import (
    LikeRadians,
    angles,
    approaches,
    number_columns,
    rates,
)
from armd.compensation.data.session_format import AngleUnit
from armd.compensation.data.table_writing import table_writer, write_group
from armd.compensation.data.temperature_columns import TemperatureColumns
from armd.compensation.data.turns import AngleRange, describe_turns, fold_turns, report_open_turns
from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import LoadedCalibration, used_sensors
from armd.compensation.model.slow_factors import Dated, SlowFactor
from armd.compensation.model.state import States
from armd.errors import BadInput
from armd.files.inputs import open_input
from armd.files.writing import whole_file

END_STOP_RAD = np.radians(0.5)
#: Rows that are written together, as one group of a Parquet file: the file's end describes every
#: group, and that is in memory until then.
GROUP_ROWS = 1 << 16


@dataclass(frozen=True)
class Taken:
    """Some readings, and all that earlier ones have to say of them."""

    states: States  # temperatures held
    slow: F64  # (n, L+T) values of the model's slow factors
    stale: Mask  # (n,) a temperature in use is missing
    published: npt.NDArray[np.uint32] | None  # (n,) flags of the samples, of points recorded live


class Corrector:
    """Corrects one file's readings: `take` in their order, `correct` in any, from any thread."""

    def __init__(
        self,
        arm: Arm,
        calibration: LoadedCalibration | None,
        unit: AngleUnit,
        started_unix_s: float | None,
    ) -> None:
        self._arm = arm
        self.columns = number_columns(arm)
        #: of the calibration, as points have it
        self.identity = 0 if calibration is None else calibration.identity
        self._unit = unit
        self._like_radians = LikeRadians(arm, unit)
        self._started_unix_s = started_unix_s
        self._model = Model(arm, calibration)
        content = calibration.content if calibration else None
        self._always = Flag(0) if calibration else Flag.NOT_CALIBRATED
        factors = [factor for term in (content.terms if content else []) for factor in term.basis]
        self._needs_date = any(isinstance(factor, Dated) for factor in factors)
        self._needs_time = self._needs_date or any(
            lag_s > 0
            for factor in factors
            if isinstance(factor, SlowFactor)
            for _, lag_s in factor.means
        )
        used = used_sensors(arm, content)
        self._used = [s for s, name in enumerate(arm.sensors) if name in used]
        ranges = content.temperature_range_c if content else {}
        low_high = [ranges.get(name, (-np.inf, np.inf)) for name in arm.sensors]
        self._range_c = np.array(low_high).reshape(-1, 2).T
        self._low, self._high = arm.limits_rad
        reference_c = content.reference_temperature_c if content else arm.reference_temperature_c
        self._held_c = np.full(len(arm.sensors), reference_c)
        self._temperature_columns = TemperatureColumns(arm, "F")
        self._lowest = self._highest = np.full(arm.n_joints, np.nan)
        #: sentences: what was read and does not count as it stands
        self.remarks: list[str] = []

    def wanted(self, header: Collection[str]) -> dict[str, pa.DataType]:
        """The columns that are asked for of a table with these, and what they hold."""
        wanted: dict[str, pa.DataType] = {
            name: pa.float64() for name in self.columns if name in header
        }
        return wanted | (RECORDED_TYPES if is_recorded(header) else {})

    def take(self, readings: Readings) -> Taken:
        """The next readings of the file, checked."""
        arm = self._arm
        # By columns, all that is asked of whole columns is several times faster.
        q = angles(readings, arm, self._unit, missing_allowed=True, order="F")
        self._like_radians.take(readings, q)
        q, turns = fold_turns(q, arm)
        rate = rates(readings, arm.n_joints)
        recorded = is_recorded(readings.header)
        time_s = instants_s(readings) if recorded else readings.optional("time_s")
        measured_c, _, remarks = self._temperature_columns.take(readings, time_s, "")
        self.remarks += [*remarks, *describe_turns(str(readings.path), turns)]
        self._lowest = np.fmin(self._lowest, np.fmin.reduce(q))
        self._highest = np.fmax(self._highest, np.fmax.reduce(q))
        states = States(
            q=q,
            rate=rate,
            temperature_c=self._hold(measured_c),
            time_s=time_s if recorded else self._time_s(readings),
            approach=approaches(readings, arm, q, rate),
            series=np.zeros(readings.n, np.int64),
        )
        slow = self._model.slow_values(states, onwards=True)
        stale: Mask = np.logical_or.reduce(np.isnan(measured_c[:, self._used]), axis=1)
        return Taken(states, slow, stale, published_flags(readings) if recorded else None)

    def ended(self, source: Path) -> None:
        """*source* has no more readings; raises `BadInput` if their unit cannot be right."""
        self._like_radians.judge()
        middle = (self._lowest + self._highest) / 2
        turned = AngleRange(str(source), self._lowest, self._highest, middle)
        self.remarks += report_open_turns([turned], self._arm)[0]

    def correct(
        self, taken: Taken, *, uncertainty: bool = True
    ) -> tuple[F64, npt.NDArray[np.uint32]]:
        """Positions and their standard uncertainties (n, 6) mm, or positions (n, 3); flags (n,).

        NaN where an angle is missing; uncertainties also where the calibration states none.
        """
        states = taken.states
        figures = position = self._model.correct_rows(states, taken.slow)[0]
        if uncertainty:
            figures = np.hstack([position, self._model.uncertainty_rows(states, taken.slow)])
        invalid = np.isnan(states.q).any(axis=1) | ~np.isfinite(
            position[:, 0] + position[:, 1] + position[:, 2]
        )
        if taken.published is not None:  # a point that was withheld stays so
            invalid |= (taken.published & np.uint32(Flag.INVALID)) != 0
        if invalid.any():
            figures[invalid] = np.nan

        low, high = self._range_c
        held_c = states.temperature_c
        outside = ((held_c < low) | (held_c > high))[:, self._used].any(axis=1)
        for since, until in self._model.periods_unix_s:  # beyond them terms are held
            outside |= (states.time_s < since) | (states.time_s > until)
        near_end = (states.q < self._low + END_STOP_RAD) | (states.q > self._high - END_STOP_RAD)
        flags = np.full(states.n, int(self._always), np.uint32)
        if taken.published is not None:
            flags |= taken.published
        for flag, rows in (
            (Flag.INVALID, invalid),
            (Flag.TEMPERATURE_RANGE, outside),
            (Flag.TEMPERATURE_STALE, taken.stale),
            (Flag.END_STOP, near_end.any(axis=1)),
        ):
            np.bitwise_or(flags, np.uint32(flag), out=flags, where=rows)
        return figures, flags

    def _hold(self, measured_c: F64) -> F64:
        """Temperatures (n, S), the last one held where one is missing; at first the reference."""
        if len(measured_c) and not np.isnan(measured_c).any():
            self._held_c = measured_c[-1].copy()
            return measured_c
        held = np.vstack([self._held_c, measured_c])
        for column in held.T:
            last = np.maximum.accumulate(np.where(np.isnan(column), 0, np.arange(len(column))))
            column[:] = column[last]
        self._held_c = held[-1].copy()
        return held[1:]

    def _time_s(self, readings: Readings) -> F64:
        if not self._needs_time:
            return np.zeros(readings.n)
        if self._needs_date and self._started_unix_s is None:
            found = "nothing"
            expected = "an instant: the calibration has terms that depend on the date"
            raise BadInput(readings.path, "--started", found, expected)
        return readings.required("time_s") + (self._started_unix_s or 0.0)


def correct_file(
    source: Path, target: Path, corrector: Corrector, progress: Callable[[float], None]
) -> int:
    """Read *source*, write *target* whole or not at all; returns the number of rows.

    CSV gives CSV, its own text kept letter by letter; Parquet gives Parquet or CSV, by the
    target's suffix. *progress* is told the share done, 0 to 1.
    """
    header = read_header(source)
    csv_source = source.suffix == ".csv"
    if csv_source and target.suffix == ".parquet":
        raise BadInput(target, "-o", "a .parquet file", "a .csv file: the input is one")
    twice = [] if is_recorded(header) else sorted(set(COLUMNS) & set(header))
    if target.suffix == ".parquet" and twice:
        raise BadInput(source, f"column {twice[0]}", "it already", "a table without it")
    wanted = corrector.wanted(header)
    n = 0
    with whole_file(target) as part:
        if csv_source:
            pieces = _csv_pieces(source, part, header, wanted, corrector)
        else:
            pieces = _parquet_pieces(source, part, target.suffix, wanted, corrector)
        for n, share in pieces:  # noqa: B007 (the last one counts)
            progress(share)
        corrector.ended(source)
        if n == 0:
            raise BadInput(source, "the file", "no readings", "at least one row")
    return n


def _csv_pieces(
    source: Path,
    part: Path,
    header: list[str],
    wanted: dict[str, pa.DataType],
    corrector: Corrector,
) -> Iterator[tuple[int, float]]:
    """Yields the number of rows and the share of the file done so far."""
    done = 0
    with open_input(source) as lines, part.open("wb") as out:
        size = os.fstat(lines.fileno()).st_size
        names = lines.readline().rstrip(b"\r\n")
        out.write(names + b"," + ",".join(COLUMNS).encode() + b"\n")

        def taken() -> Iterator[tuple[list[bytes], Taken, int]]:
            begun = 0
            for piece in line_pieces(source, lines):
                rows = [line for line in piece if line.strip()]  # a blank line is no row
                if not rows:
                    continue
                table = parse_csv(source, io.BytesIO(b"\n".join(rows) + b"\n"), header, wanted)
                if len(table) != len(rows):
                    found = "a line break inside a value"
                    raise BadInput(source, f"after row {begun}", found, "one line per row")
                new = corrector.take(Readings(source, header, table, begun))
                begun += len(rows)
                yield rows, new, lines.tell()

        def written(piece: tuple[list[bytes], Taken, int]) -> tuple[list[bytes], bytes, int]:
            rows, new, end = piece
            text = pa.BufferOutputStream()
            options = pa.csv.WriteOptions(include_header=False)
            pa.csv.write_csv(make_point_columns(*corrector.correct(new)), text, options)
            return rows, text.getvalue().to_pybytes(), end

        for rows, text, end in in_order(written, taken()):
            added = text.splitlines(keepends=True)
            out.writelines(
                old.rstrip(b"\r") + b"," + new for old, new in zip(rows, added, strict=True)
            )
            done += len(rows)
            yield done, end / size


def _parquet_pieces(
    source: Path, part: Path, suffix: str, wanted: dict[str, pa.DataType], corrector: Corrector
) -> Iterator[tuple[int, float]]:
    """Yields the number of rows and the share of the file done so far."""
    done = 0
    with open_parquet(source) as file:
        old = file.schema_arrow
        added = [(name, pa.float64()) for name in COLUMNS[:-1]] + [(COLUMNS[-1], pa.uint32())]
        kept = drop_published(old.empty_table(), corrector.identity).schema
        schema = pa.schema([*kept, *pa.schema(added)])

        def taken() -> Iterator[tuple[pa.Table, Taken]]:
            begun = 0
            for table in parquet_pieces(source, file):
                asked = cast_columns(source, table, wanted)
                yield table, corrector.take(Readings(source, old.names, asked, begun))
                begun += len(table)

        def corrected(piece: tuple[pa.Table, Taken]) -> pa.Table:
            table, new = piece
            table = drop_published(table, corrector.identity)
            columns = [*table.columns, *make_point_columns(*corrector.correct(new)).columns]
            return pa.Table.from_arrays(columns, schema=schema)

        with table_writer(source, part, suffix, schema) as out:
            group: list[pa.Table] = []
            for table in in_order(corrected, taken()):
                group.append(table)
                if sum(map(len, group)) >= GROUP_ROWS:
                    write_group(source, out, group)
                    group.clear()
                done += len(table)
                yield done, done / file.metadata.num_rows
            if group:
                write_group(source, out, group)

"""Reads a session's folder for the twin: columns as arrays, other cells unchanged.

`armd check` has checked the files before, so they are valid.
"""

from __future__ import annotations

import csv
import io
import math
import tomllib
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armd.arrays import F64, I64
from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.simulator.twin.files import ArmData
from armd.simulator.twin.placing import CertifiedDistance, TouchedRows

MISSING = ("", "nan", "NaN", "NAN")
TABLES = ("readings.csv", "readings.parquet")
KNOWN_OF_ARTEFACT = {
    "name", "certificate", "expansion_per_k", "reference_temperature_c", "target", "distance"
}  # fmt: skip


@dataclass(frozen=True)
class SourceSession:
    """A session folder that was read."""

    folder: Path
    table: str  # name of its file
    header: list[str]
    columns: dict[str, list[Any]]  # every cell unchanged
    file: Mapping[str, Any]  # session.toml

    @property
    def n(self) -> int:
        return len(self.columns["placement"])

    def numbers(self, name: str) -> F64:
        """Return a column (n,), NaN where a cell or the whole column is missing."""
        cells = self.columns.get(name)
        if cells is None:
            return np.full(self.n, np.nan)
        return np.array([_number(cell) for cell in cells])

    def side_by_side(self, *names: str) -> F64:
        """Return columns (n, names)."""
        return np.stack([self.numbers(name) for name in names], axis=1)

    def numbered(self, name: str) -> tuple[I64, list[str]]:
        """Return a column of names as indices (n,) into the list of distinct names."""
        names = list(dict.fromkeys(map(str, self.columns[name])))
        place = {text: i for i, text in enumerate(names)}
        return np.array([place[str(text)] for text in self.columns[name]]), names

    def radians_per_unit(self, arm: ArmData) -> F64:
        """Return (N,) rad per unit of the angles' columns, signed."""
        unit = self.file.get("angle_unit", "rad")
        if unit == "count":
            turns = np.array([float(counts or math.nan) for counts in arm.counts_per_turn])
            units: F64 = arm.direction * math.tau / turns
            return units
        return np.full(arm.n_joints, 1.0 if unit == "rad" else math.radians(1.0))

    def angles(self, arm: ArmData) -> F64:
        """Return the angles (n, N) rad, with the turns of the table."""
        names = [f"q{k}" for k in range(1, arm.n_joints + 1)]
        angles: F64 = self.side_by_side(*names) * self.radians_per_unit(arm)
        return angles

    def unix_s(self) -> F64:
        """Return the times (n,), NaN where no time is known."""
        unix_s: F64 = self.file["started"].timestamp() + self.numbers("time_s")
        return unix_s

    def with_angles(self, q: F64, arm: ArmData) -> bytes:
        """Return the table with angles *q* (n, N) rad and every other cell unchanged."""
        values = q / self.radians_per_unit(arm)
        if self.file.get("angle_unit") == "count":
            values = np.rint(values)
        columns = dict(self.columns)
        is_count = self.file.get("angle_unit") == "count"
        for k in range(arm.n_joints):
            column = values[:, k].tolist()
            columns[f"q{k + 1}"] = [int(value) for value in column] if is_count else column
        return _csv(columns) if self.table.endswith(".csv") else _parquet(columns)


def read_session(folder: Path, arm: ArmData) -> SourceSession:
    """Read a session of *arm*.

    Raises `BadInput` for another arm's, and for an artefact that a twin cannot measure.
    """
    path = folder / "session.toml"
    file = tomllib.loads(read_input(path).decode("utf-8-sig"))
    if file["arm"] != arm.serial_number:
        raise BadInput(path, "arm", repr(file["arm"]), f"{arm.serial_number!r}, as in arm.toml")
    for key in file["artefact"].keys() - KNOWN_OF_ARTEFACT:
        raise BadInput(path, f"artefact.{key}", "it", "points and lengths: a twin knows no others")
    table = next(name for name in TABLES if (folder / name).exists())
    header, columns = _read_table(folder / table)
    return SourceSession(folder, table, header, columns, file)


#: (certified item, its standard uncertainty in mm, how many numbers) → its errors (n,)
CertificateErrors = Callable[[str, float, int], F64]


def draw_no_errors(_: str, __: float, count: int) -> F64:
    """Return the errors of a perfect certificate: zero."""
    return np.zeros(count)


def draw_certificate_errors(seed: int) -> CertificateErrors:
    """Return a function that draws errors by each standard uncertainty.

    They are the same for one certificate in all sessions.
    """

    def draw(certified_item: str, uncertainty_mm: float, count: int) -> F64:
        rng = np.random.default_rng([seed, zlib.crc32(certified_item.encode())])
        return uncertainty_mm * rng.normal(size=count)

    return draw


def list_touched(
    session: SourceSession, correction: Mapping[str, Any], errors: CertificateErrors
) -> tuple[TouchedRows, F64, list[CertifiedDistance]]:
    """List the touched targets: true positions (K, 3) mm (NaN: unknown) and lengths.

    *correction*: a calibration's `artefact`, used if this artefact's name is among its `artefacts`.
    """
    artefact = session.file["artefact"]
    artefact_name, unsure = artefact["name"], "standard_uncertainty_mm"
    named = correction.get("artefacts") or [artefact["name"]]
    if artefact["name"] not in named:
        correction = {}
    certified = {t["name"]: t.get("position_mm") for t in artefact.get("target", [])}
    ends = [d["between"] for d in artefact.get("distance", [])]
    target, touched_names = session.numbered("target")
    every = dict.fromkeys([*certified, *(name for pair in ends for name in pair), *touched_names])
    names = list(every)
    nowhere = [math.nan] * 3
    position_mm = np.array([certified.get(name) or nowhere for name in names], dtype=float)
    for one_target in artefact.get("target", []):
        error_mm = errors(f"{artefact_name}/{one_target['name']}", one_target.get(unsure, 0.0), 3)
        position_mm[names.index(one_target["name"])] += error_mm
    for name, offset in correction.get("target_offset_mm", {}).items():
        if name in every:
            position_mm[names.index(name)] += offset
    lengths = [
        CertifiedDistance(
            (names.index(first_name), names.index(second_name)),
            float(
                d["length_mm"]
                + errors(f"{artefact_name}/{first_name} to {second_name}", d.get(unsure, 0.0), 1)[0]
            ),
        )
        for d, (first_name, second_name) in zip(artefact.get("distance", []), ends, strict=True)
        if first_name in touched_names and second_name in touched_names
    ]
    touched = TouchedRows(
        placement=session.numbered("placement")[0],
        target=np.array([names.index(name) for name in touched_names])[target],
        truth_mm=session.side_by_side("x_mm", "y_mm", "z_mm"),
        stretch=_stretch(session, artefact, correction),
    )
    return touched, position_mm, lengths


def _stretch(
    session: SourceSession, artefact: Mapping[str, Any], correction: Mapping[str, Any]
) -> F64:
    """Return the artefact's size (n,) relative to its certificate.

    A row without its temperature has the last one before it, the first rows the first. Without any,
    the artefact is at its reference temperature.
    """
    celsius = session.numbers("artefact_c")
    rows_with_temperature = np.flatnonzero(np.isfinite(celsius))
    rise = np.zeros(session.n)
    if len(rows_with_temperature):
        last = np.searchsorted(rows_with_temperature, np.arange(session.n), side="right") - 1
        rise = celsius[rows_with_temperature[np.maximum(last, 0)]] - artefact.get(
            "reference_temperature_c", 20.0
        )
    expansion = correction.get("expansion_per_k")
    expansion = artefact.get("expansion_per_k", 0.0) if expansion is None else expansion
    stretch: F64 = correction.get("scale", 1.0) * (1.0 + expansion * rise)
    return stretch


def _number(cell: Any) -> float:
    if cell is None or (isinstance(cell, str) and cell.strip() in MISSING):
        return math.nan
    return float(cell)


def _read_table(path: Path) -> tuple[list[str], dict[str, list[Any]]]:
    if path.suffix == ".parquet":
        import pyarrow.parquet as parquet  # loaded late: most sessions are text

        table = parquet.read_table(path)
        return list(table.column_names), table.to_pydict()
    text = read_input(path, 1 << 31).decode("utf-8-sig")
    rows = [row for row in csv.reader(io.StringIO(text)) if row]
    header = [name.strip() for name in rows[0]]
    cells = [list(column) for column in zip(*rows[1:], strict=True)]
    return header, dict(zip(header, cells, strict=True))


def _csv(columns: Mapping[str, list[Any]]) -> bytes:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows(zip(*columns.values(), strict=True))
    return text.getvalue().encode()


def _parquet(columns: Mapping[str, list[Any]]) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as parquet

    content = io.BytesIO()
    parquet.write_table(
        pa.table({name: pa.array(values) for name, values in columns.items()}), content
    )
    return content.getvalue()

"""`armd correct` and `armd evaluate` on long tables: time and memory for each reading.

Readings at 1 kHz, a temperature every half second, as Parquet; once some and once eight times as
many (ROWS=100000000 for another number: 30 GB of disk). `evaluate` gets what `correct` wrote, as a
session whose every reading stands where it was corrected to: so its residuals must be nothing. The
floors are DuckDB reading every value of the same file, and DuckDB writing it anew with as many
columns as `correct` adds; and Arrow reading it in the same pieces. Of three rounds, in each of
which all take their turn, the least time and the highest memory count.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import offline_stages
import pyarrow as pa
import pyarrow.parquet
from measured import measured

from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import load_calibration, save_calibration
from armd.files.toml_text import format_toml
from support.drawn import drawn
from support.synthetic import STARTED
from support.synthetic import arm as synthetic_arm

SHORT = 500_000
ROWS = int(os.environ.get("ROWS", 8 * SHORT))
PIECE = 1 << 16
ROUNDS = 3

ARROW = """
import sys, pyarrow.parquet
with pyarrow.parquet.ParquetFile(sys.argv[1], pre_buffer=False) as file:
    for batch in file.iter_batches(1 << 16):
        pass
"""
DUCKDB_READ = """
import sys, duckdb
duckdb.sql(f"SELECT sum(hash(COLUMNS(*))) FROM '{sys.argv[1]}'").fetchall()
"""
DUCKDB_COPY = """
import sys, duckdb
more = ", ".join(f"q{k} AS new_{k}" for k in range(1, 7))
table = f"SELECT *, {more}, 0::UINTEGER AS flags FROM '{sys.argv[1]}'"
duckdb.sql(f"COPY ({table}) TO '{sys.argv[1]}.copy' (FORMAT parquet)")
"""
FLOORS = {"arrow": ARROW, "duckdb_read": DUCKDB_READ, "duckdb_copy": DUCKDB_COPY}


def run() -> dict[str, Any]:
    """Seconds and processor seconds (all cores), µs a reading, peak MB; by number of readings."""
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix="armd-bench-", dir=os.environ.get("TMPDIR")) as made:
        folder = Path(made)
        _write_model(folder)
        # The length that nothing depends on is taken off: starting, loading, compiling.
        _figures(folder, 1000)
        for rows in (SHORT, ROWS):
            figures[f"{rows}_rows"] = _figures(folder, rows)
            if rows == SHORT:
                figures["stages"] = _stages(folder, rows)
    short, long = (figures[f"{rows}_rows"] for rows in (SHORT, ROWS))
    for name in ("correct", "evaluate", *FLOORS):
        more = long[name]["processor_s"] - short[name]["processor_s"]
        figures[f"{name}_processor_us_a_reading"] = 1e6 * more / (ROWS - SHORT)
        figures[f"{name}_times_duckdb_copy"] = (
            long[name]["seconds"] / long["duckdb_copy"]["seconds"]
        )
        figures[f"{name}_peak_ratio"] = long[name]["peak_mb"] / short[name]["peak_mb"]
    return figures


def shown(figures: Mapping[str, Any]) -> list[str]:
    """Processor time by stage of the shorter table, one thread; below it the floors."""
    copy, read = (figures[f"duckdb_{way}_processor_us_a_reading"] for way in ("copy", "read"))
    floors = f"DuckDB: {copy:.3f} to read and write as many columns, {read:.3f} to read"
    return [*offline_stages.table(figures["stages"]), floors]


def _figures(folder: Path, rows: int) -> dict[str, Any]:
    table, corrected = folder / "table.parquet", folder / "session/readings.parquet"
    _write_readings(table, rows)
    model = ["--arm", str(folder / "arm.toml"), "--calibration", str(folder / "cal.json")]
    armd, quiet = [sys.executable, "-m", "armd"], ["--force", "-q"]
    result = str(folder / "result.json")
    programs = {
        name: [sys.executable, "-c", program, str(table)] for name, program in FLOORS.items()
    }
    programs["correct"] = [*armd, "correct", str(table), *model, "-o", str(corrected), *quiet]
    programs["evaluate"] = [
        *armd, "evaluate", str(corrected.parent), *model, "--json", result, *quiet
    ]  # fmt: skip
    rounds: dict[str, list[dict[str, float]]] = {name: [] for name in programs}
    for _ in range(ROUNDS):
        for name, program in programs.items():
            rounds[name].append(measured(program))
    figures = {
        name: {
            "seconds": min(once["seconds"] for once in all_of_them),
            "processor_s": min(once["processor_s"] for once in all_of_them),
            "peak_mb": max(once["peak_mb"] for once in all_of_them),
        }
        for name, all_of_them in rounds.items()
    }
    found = json.loads(Path(result).read_text())
    if found["n"] != rows or found["max_um"] > 1e-3:
        raise AssertionError(f"{found['n']} of {rows} readings, one off by {found['max_um']} µm")
    return figures


def _stages(folder: Path, rows: int) -> dict[str, dict[str, float]]:
    arm, calibration = load_arm(folder / "arm.toml"), load_calibration(folder / "cal.json")
    source, target = folder / "table.parquet", folder / "session/readings.parquet"
    return {
        "correct": offline_stages.correct_stages(source, arm, calibration, target, rows),
        "evaluate": offline_stages.evaluate_stages(target.parent, arm, calibration, rows),
    }


def _write_model(folder: Path) -> None:
    arm = synthetic_arm()
    (folder / "session").mkdir()
    (folder / "arm.toml").write_text(format_toml(arm.model_dump(by_alias=True, exclude_none=True)))
    names = [f"{letter}_{k}" for letter in "da" for k in range(1, 7)]
    calibration = drawn(
        arm,
        temperature_range_c={f"t{k}": [10.0, 40.0] for k in range(1, 7)},
        terms=[_expansion(f"a_{k}", f"t{k}") for k in range(1, 7)],
        covariance_of=names,
        covariance=(1e-6 * np.eye(len(names))).tolist(),
        noise={"encoder_rad": [2e-6] * 6, "temperature_c": 0.1},
    )
    save_calibration(folder / "cal.json", calibration)
    session = {
        "schema": "armd.session/1",
        "arm": arm.serial_number,
        "started": STARTED,
        "angle_unit": "rad",
        "artefact": {"name": "tracker", "target": [{"name": "reflector"}]},
    }
    (folder / "session/session.toml").write_text(format_toml(session))


def _expansion(parameter: str, sensor: str) -> dict[str, Any]:
    factor = {"kind": "temperature", "weights": {sensor: 1.0}}
    return {"parameter": parameter, "basis": [factor], "coefficient": 1e-2}


def _write_readings(path: Path, rows: int) -> None:
    names = [f"q{k}" for k in range(1, 7)] + [f"t{k}" for k in range(1, 7)]
    numbers = ["time_s", *names]
    schema = pa.schema(
        [("placement", pa.string()), ("target", pa.string()), *((n, pa.float64()) for n in numbers)]
    )
    speeds, phases = np.array([0.31, 0.23, 0.41, 0.53, 0.61, 0.7]), np.arange(6)
    with pa.parquet.ParquetWriter(path, schema) as file:
        for first in range(0, rows, PIECE):
            time_s = np.arange(first, min(rows, first + PIECE)) * 1e-3
            q = np.round(1.5 * np.sin(time_s[:, None] * speeds + phases), 9)
            hour = np.floor(2 * time_s)[:, None] / 7200
            celsius = np.round(22 + 3 * np.sin(hour + phases), 2)
            texts = [pa.array([text] * len(q)) for text in ("P1", "reflector")]
            columns = [*texts, *(pa.array(c) for c in (time_s, *q.T, *celsius.T))]
            file.write_table(pa.Table.from_arrays(columns, schema=schema))

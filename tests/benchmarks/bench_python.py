"""armd in Python: what imports take, a call beside its command, and tables beside the kernel.

Times of tables are processor times on one core, the least and the median of some rounds taken in
turn, so that a busy machine slows all alike.
"""

from __future__ import annotations

import importlib.util
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from measured import measured, on_cores

import armd
from support.published import make_lake

ROWS = 1_000_000
LAKE_ROWS = 600_000
ROUNDS = 7
LAKE_PY = Path(__file__).parents[2] / "docs" / "examples" / "lake.py"
DAY = "serial=SIM-0001/day=2026-03-01"
ARMD = [sys.executable, "-m", "armd"]


def run() -> dict[str, Any]:
    """Seconds, MB, ratios, rows a second."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _quietly([*ARMD, "simulate", "--session", "calibration", "-o", str(folder)])
        calibration = folder / "calibration.json"
        sessions = [str(path) for path in sorted(folder.glob("T*"))]
        words = ["--arm", str(folder / "arm.toml"), "-o", str(calibration)]
        _quietly([*ARMD, "calibrate", *sessions, *words])
        files = folder / "arm.toml", calibration
        return {
            "imports": _imports(),
            "evaluate": _evaluate(sessions, *files),
            "table": _table(*files),
            "lake": _lake(folder, *files),
        }


def _imports() -> dict[str, dict[str, float]]:
    """Python alone, `import armd`, and the first use of the offline half."""
    scripts = {"python": "pass", "armd": "import armd", "offline": "import armd; armd.Corrector"}
    return {name: measured([sys.executable, "-c", text]) for name, text in scripts.items()}


def _evaluate(sessions: list[str], arm: Path, calibration: Path) -> dict[str, float]:
    """The command, and the call in a process that has what it needs."""
    words = ["evaluate", *sessions, "--arm", str(arm), "--calibration", str(calibration)]
    armd.evaluate(sessions, arm, calibration)
    began = time.perf_counter()
    armd.evaluate(sessions, arm, calibration)
    call_s = time.perf_counter() - began
    return {"call_s": call_s, "command_s": measured([*ARMD, *words])["seconds"]}


def _table(arm_file: Path, calibration: Path) -> dict[str, Any]:
    """A million rows, at one temperature and at another each: the mark is of a table like these."""
    arm = armd.read_arm(arm_file)
    rng = np.random.default_rng(1)
    q = rng.uniform(-1.0, 1.0, (ROWS, arm.n_joints))
    shape = (ROWS, len(arm.sensors))
    steps = np.repeat(21 + rng.normal(size=(ROWS // 500, shape[1])), 500, axis=0)
    kinds = {"one_temperature": np.full(shape, 22.0), "steps_of_500_rows": steps}
    model = armd.Model(arm, calibration)
    plain = armd.Corrector(arm, calibration, uncertainty=False)
    whole = armd.Corrector(arm, calibration)
    figures: dict[str, Any] = {}
    for kind, celsius in kinds.items():
        columns = {f"q{k + 1}": np.ascontiguousarray(column) for k, column in enumerate(q.T)}
        columns |= {
            name: np.ascontiguousarray(column)
            for name, column in zip(arm.sensors, celsius.T, strict=True)
        }
        table = pa.table(columns)

        def position(celsius: Any = celsius) -> object:
            return model.position(q, celsius)

        def correct(table: pa.Table = table) -> object:
            return plain(table)

        def correct_with_uncertainty(table: pa.Table = table) -> object:
            return whole(table)

        ways = {
            "position": position,
            "corrector": correct,
            "corrector_with_uncertainty": correct_with_uncertainty,
        }
        with on_cores(1):
            figures[kind] = _beside(ways)
    return figures


def _beside(ways: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Processor seconds of each, the least and the median, and how many times the first's."""
    used_s: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(ROUNDS):
        for name, way in ways.items():
            way()  # so that the memory which it frees is near when it is timed
            began_s = time.process_time()
            way()
            used_s[name].append(time.process_time() - began_s)
    first, *rest = ways
    least_s = {name: min(rounds) for name, rounds in used_s.items()}
    median_s = {name: statistics.median(rounds) for name, rounds in used_s.items()}
    return {
        **{f"{name}_s": seconds for name, seconds in least_s.items()},
        **{f"{name}_median_s": seconds for name, seconds in median_s.items()},
        **{f"{name}_ratio": least_s[name] / least_s[first] for name in rest},
        **{f"{name}_median_ratio": median_s[name] / median_s[first] for name in rest},
    }


def _lake(folder: Path, arm: Path, calibration: Path) -> dict[str, float]:
    """A day of a lake, read, corrected and written by docs/examples/lake.py on one core."""
    spec = importlib.util.spec_from_file_location("lake", LAKE_PY)
    assert spec is not None and spec.loader is not None
    lake = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(lake)
    make_lake(folder / "lake", "SIM-0001", ["2026-03-01"], LAKE_ROWS, files=20)
    size = sum(path.stat().st_size for path in (folder / "lake" / DAY).iterdir())
    figures = {"bytes_a_row": size / LAKE_ROWS}
    with on_cores(1):
        for name, uncertainty in (("with_uncertainty", True), ("without", False)):
            corrector = armd.Corrector(arm, calibration, uncertainty=uncertainty)
            best_s = float("inf")
            for number in range(3):
                target = str(folder / f"{name}-{number}")
                used_s = time.process_time()
                assert lake.correct_day(str(folder / "lake"), DAY, target, corrector) == LAKE_ROWS
                best_s = min(best_s, time.process_time() - used_s)
            figures[f"processor_us_a_row_{name}"] = 1e6 * best_s / LAKE_ROWS
            figures[f"rows_a_second_and_core_{name}"] = LAKE_ROWS / best_s
            figures[f"core_hours_for_1e12_rows_{name}"] = 1e12 * best_s / LAKE_ROWS / 3600
        written = folder / "without-0" / DAY / "points.parquet"
        assert pq.ParquetFile(written).metadata.num_rows == LAKE_ROWS
    return figures


def _quietly(command: list[str]) -> None:
    subprocess.run(command, check=True, capture_output=True)

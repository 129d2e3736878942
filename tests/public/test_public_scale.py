"""docs/how-to/scale.md: its programs run as they stand, on clusters of two processes here."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import armd
from armd.daemon.cli import main
from support.measured_arm import measured_arm
from support.pages import page_path
from support.published import make_lake, save_lagged

DOCS = Path(__file__).parents[2] / "docs"
SERIALS, DAYS = ("SYN-1", "SYN-2"), ("2026-03-01", "2026-03-02")


def load_example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("lake", DOCS / "examples" / "lake.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two arms with a lake of two days, and the page's programs."""
    folder = tmp_path_factory.mktemp("scale")
    for number, serial in enumerate(SERIALS):
        arm = folder / "arms" / serial
        arm.mkdir(parents=True)
        measured = measured_arm(arm, readings=12)
        measured.arm_file.write_text(measured.arm_file.read_text().replace("SYN-1", serial))
        save_lagged(arm / "calibration.json", serial, 0.01, seed=number)
        make_lake(folder / "lake", serial, DAYS, 3000)
    for block in re.findall(r"```python\n(# (\w+\.py)\n.*?)```", page(), re.DOTALL):
        (folder / block[1]).write_text(block[0])
    shutil.copy(DOCS / "examples" / "lake.py", folder)
    return folder


def page() -> str:
    return page_path("scale").read_text(encoding="utf-8")


def rows_of(folder: Path) -> pa.Table:
    files = sorted(folder.glob("*.parquet"))
    return pa.concat_tables([pq.read_table(file, partitioning=None) for file in files])


def by_command(folder: Path, serial: str, day: str, tmp_path: Path) -> pa.Table:
    """What `armd correct` writes of a day's rows after those that they depend on."""
    arm = folder / "arms" / serial
    rows, lead = rows_of(folder / f"lake/serial={serial}/day={day}"), 0
    if day != DAYS[0]:
        corrector = armd.Corrector(arm / "arm.toml", arm / "calibration.json")
        before = corrector.lead_in(rows_of(folder / f"lake/serial={serial}/day={DAYS[0]}"))
        rows, lead = pa.concat_tables([before, rows]), len(before)
    source, target = tmp_path / "rows.parquet", tmp_path / f"{serial}-{day}.parquet"
    pq.write_table(rows, source)
    words = ["correct", str(source), "--arm", str(arm / "arm.toml"), "-o", str(target), "--quiet"]
    assert main([*words, "--calibration", str(arm / "calibration.json")]) == 0
    return pq.read_table(target).slice(lead)


def run(folder: Path, name: str) -> str:
    done = subprocess.run([sys.executable, name], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_day_is_corrected_once_and_as_by_the_command(folder: Path, tmp_path: Path) -> None:
    lake, arm = load_example(), folder / "arms" / "SYN-1"
    corrector = armd.Corrector(arm / "arm.toml", arm / "calibration.json")
    places = str(folder / "lake"), str(tmp_path)
    assert lake.list_days(places[0]) == [f"serial={s}/day={d}" for s in SERIALS for d in DAYS]
    for day in DAYS:
        partition = f"serial=SYN-1/day={day}"
        assert lake.correct_day(places[0], partition, places[1], corrector) == 3000
        written = pq.read_table(tmp_path / partition / "points.parquet", partitioning=None)
        assert written.equals(by_command(folder, "SYN-1", day, tmp_path))
        assert lake.correct_day(places[0], partition, places[1], corrector) == 0


def test_parts_of_a_day_are_as_the_whole(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lake, arm = load_example(), folder / "arms" / "SYN-1"
    monkeypatch.setattr(lake, "ROWS_AT_ONCE", 1000)  # a file is larger: each is a part
    corrector = armd.Corrector(arm / "arm.toml")  # without lags they are so bit for bit
    day = f"serial=SYN-1/day={DAYS[0]}"
    assert lake.correct_day(str(folder / "lake"), day, str(tmp_path), corrector) == 3000
    written = pq.read_table(tmp_path / day / "points.parquet", partitioning=None)
    assert written.equals(corrector(rows_of(folder / "lake" / day)))


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("engine", ["ray", "dask"])
def test_a_cluster_of_two_corrects_what_is_missing(
    engine: str, folder: Path, tmp_path: Path
) -> None:
    pytest.importorskip("ray" if engine == "ray" else "distributed")
    target = folder / "corrected"
    shutil.rmtree(target, ignore_errors=True)
    assert "12000 rows corrected" in run(folder, f"with_{engine}.py")
    written = {path: path.stat().st_mtime_ns for path in target.glob("*/*/points.parquet")}
    assert len(written) == 4
    for path in written:
        serial, day = (name.split("=")[1] for name in path.parts[-3:-1])
        expected = by_command(folder, serial, day, tmp_path)
        assert pq.read_table(path, partitioning=None).equals(expected)
    removed = next(iter(written))
    removed.unlink()
    assert "3000 rows corrected" in run(folder, f"with_{engine}.py")
    again = {path: path.stat().st_mtime_ns for path in target.glob("*/*/points.parquet")}
    assert {path for path in again if again[path] != written[path]} == {removed}


@pytest.mark.slow
def test_duckdb_reads_and_writes(folder: Path) -> None:
    count = next(text for text in re.findall(r"```python\n(.*?)```", page(), re.DOTALL))
    (folder / "count.py").write_text(count)
    assert re.findall(r"SYN-1 .* 3000 ", run(folder, "count.py"))
    run(folder, "with_duckdb.py")
    written = pq.read_table(folder / "by_duckdb").sort_by("stamp_ns")
    arm = folder / "arms" / "SYN-1"
    rows = rows_of(folder / f"lake/serial=SYN-1/day={DAYS[0]}")  # one batch of DuckDB's
    expected = armd.Corrector(arm / "arm.toml", arm / "calibration.json")(rows)
    for name in expected.column_names:
        assert written[name].combine_chunks().equals(expected[name].combine_chunks()), name


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_broken_history_stops_nobody_else(folder: Path) -> None:
    pytest.importorskip("distributed")
    simulated, histories = folder / "simulated", folder / "histories"
    for kind, more in (("calibration", []), ("interim", ["--days", "4"])):
        place = simulated if kind == "calibration" else simulated / "checks"
        command = ["simulate", "--session", kind, "-o", str(place), "--seed", "5", *more]
        assert subprocess.run([sys.executable, "-m", "armd", *command]).returncode == 0
    arm, calibration = simulated / "arm.toml", simulated / "calibration.json"
    sessions = [str(path) for path in sorted(simulated.glob("T*"))]
    assert main(["calibrate", *sessions, "--arm", str(arm), "-o", str(calibration)]) == 0
    checks = [str(path) for path in sorted((simulated / "checks").glob("day-*"))]
    files = ["--arm", str(arm), "--calibration", str(calibration)]
    for name in ("A", "C"):
        command = ["interim", "add", *checks, *files, "--history", str(histories / name)]
        assert main(command) == 0
    (histories / "B").mkdir()
    rows = json.loads(run(folder, "night.py"))
    assert [(row["arm"], row["state"]) for row in rows] == [
        ("A", "in_control"), ("B", "failed"), ("C", "in_control"),
    ]  # fmt: skip
    assert "B" in rows[1]["remark"] and rows[0]["remark"] == "4 checks"

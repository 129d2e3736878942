"""The examples in C, C++ and C# read points as Python does: compiled by what this machine has."""

from __future__ import annotations

import io
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import armd
from armd import POINT, Flag, Lost
from support.pages import page_path

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
WARNINGS = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-O1", "-DFROM_STDIN"]


def recorded() -> np.ndarray:
    """Points with every kind of gap: none, upstream, here, a reboot, a daemon's restart."""
    seq = [1, 2, 5, 6, 9, (1 << 32) + 3, (1 << 32) + 4, 0, 1]
    points = np.zeros(len(seq), POINT)
    points["seq"] = seq
    rng = np.random.default_rng(5)
    points["position_mm"] = rng.uniform(-900, 900, (len(seq), 3))
    points["flags"] = int(Flag.AT_REST)
    points["flags"][2] |= int(Flag.SAMPLES_LOST)
    points["flags"][3] = int(Flag.INVALID)
    points["position_mm"][3] = np.nan
    points["calibration"][1:] = int.from_bytes(bytes.fromhex("0123456789abcdef"), "little")
    return points


def expected(points: np.ndarray) -> list[str]:
    told = []
    for point in points:
        calibration = int(point["calibration"]).to_bytes(8, "little").hex()
        if point["flags"] & Flag.INVALID:
            told.append(f"{point['seq']} invalid")
        else:
            x, y, z = point["position_mm"]
            told.append(
                f"{point['seq']} {x:.6f} {y:.6f} {z:.6f} mm flags {point['flags']} "
                f"calibration {calibration if point['calibration'] else '-'}"
            )
    lost = Lost()
    lost.count(points)
    assert (lost.upstream, lost.here, lost.restarts) == (2, 2, 2)
    return [*told, f"lost: {lost.upstream} upstream, {lost.here} here, {lost.restarts} restarts"]


@pytest.mark.parametrize(
    ("compiler", "source", "standard"),
    [("cc", "subscriber.c", "-std=c11"), ("c++", "subscriber.cpp", "-std=c++17")],
)
def test_c_and_cpp(compiler: str, source: str, standard: str, tmp_path: Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} here")
    program = tmp_path / "subscriber"
    command = [compiler, standard, *WARNINGS, str(EXAMPLES / source), "-o", str(program)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    points = recorded()
    told = subprocess.run([program], input=points.tobytes(), capture_output=True, check=True)
    assert told.stdout.decode().splitlines() == expected(points)


def test_c_sharp(tmp_path: Path) -> None:
    source = EXAMPLES / "subscriber.cs"
    if shutil.which("mcs") and shutil.which("mono"):  # Debian's mono-mcs, mono-runtime
        program = tmp_path / "subscriber.exe"
        build = ["mcs", "-warnaserror", f"-out:{program}", str(source)]
        subprocess.run(build, check=True)
        run = ["mono", str(program)]
    elif shutil.which("dotnet"):
        subprocess.run(["dotnet", "new", "console", "-o", str(tmp_path)], check=True)
        shutil.copy(source, tmp_path / "Program.cs")
        run = ["dotnet", "run"]
    else:
        pytest.skip("neither mcs nor dotnet here: the C# example is not compiled")
    points = recorded()
    told = subprocess.run(
        run, cwd=tmp_path, input=points.tobytes(), capture_output=True, check=True
    )
    assert told.stdout.decode().splitlines() == expected(points)


def test_the_header_has_every_flag() -> None:
    header = (EXAMPLES / "armd_point.h").read_text(encoding="utf-8")
    flags = {name: 1 << int(bit) for name, bit in re.findall(r"ARMD_(\w+) = 1 << (\d+)", header)}
    assert flags == {flag.name: int(flag) for flag in Flag}


def test_c_sharp_reads_every_field_in_its_place() -> None:
    """Also where there is no compiler: what is read, field by field, is the layout."""
    sharp = (EXAMPLES / "subscriber.cs").read_text(encoding="utf-8")
    kinds = {"UInt64": "<u8", "Int64": "<i8", "Double": "<f8", "Single": "<f4", "UInt32": "<u4"}
    read = []
    for times, what in re.findall(r"(?:i < (\d); i\+\+\) \S+ = )?from\.Read(\w+)\(", sharp):
        kind = kinds.get(what, "<u8")  # the calibration is kept as bytes
        read.append((kind, (int(times),)) if times else (kind, ()))
    assert POINT.fields is not None
    layout = [field[0] for field in POINT.fields.values()]
    assert read == [(field.base.str, field.shape) for field in layout[:-1]]  # the last is reserved


def test_the_command_of_the_documentation_makes_a_file_of_points(monkeypatch, tmp_path) -> None:
    """As docs/reference/subscriber.md has it, on an arm that is played here."""
    document = page_path("subscriber").read_text(encoding="utf-8")
    found = re.search(r"^python -c '(.*)' > points.bin$", document, re.MULTILINE)
    assert found is not None
    points, asked = recorded(), []

    def batches(seconds: float) -> list[np.ndarray]:
        asked.append(seconds)
        return [points[:4], points[4:]]

    monkeypatch.setattr(armd, "connect", lambda: SimpleNamespace(batches=batches))
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", SimpleNamespace(buffer=written))
    exec(compile(found[1], "docs/reference/subscriber.md", "exec"), {})
    assert asked == [5] and written.getvalue() == points.tobytes()
    assert "./subscriber < points.bin" in document

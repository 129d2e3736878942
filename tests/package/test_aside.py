"""Progress and remarks: on a terminal, never where there is none, and none of them with -q."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from armd.compiled import compiler, jit


def on_a_terminal(*command: str, cwd: Path, **environment: str) -> tuple[str, str]:
    """What it says on standard output, a pipe, and on standard error, a terminal."""
    ours, theirs = pty.openpty()
    running = subprocess.Popen(
        command, cwd=cwd, stdout=subprocess.PIPE, stderr=theirs, stdin=subprocess.DEVNULL,
        env={**os.environ, "TERM": "xterm", **environment},
    )  # fmt: skip
    os.close(theirs)
    said = b""
    try:
        while part := os.read(ours, 65536):
            said += part
    except OSError:  # Linux' end of a terminal
        pass
    os.close(ours)
    out, _ = running.communicate()
    assert running.returncode == 0, said
    return out.decode(), said.decode()


def test_a_bar_on_a_terminal_alone(tmp_path: Path) -> None:
    simulate = (sys.executable, "-m", "armd", "simulate", "--session", "interim", "--days", "3")
    out, said = on_a_terminal(*simulate, "-o", "loud", cwd=tmp_path)
    assert "measuring with the simulated arm" in said and out.startswith("3 sessions")
    out, said = on_a_terminal(*simulate, "-o", "quiet", "-q", cwd=tmp_path)
    assert said == "" and out.startswith("3 sessions")
    out, said = on_a_terminal(*simulate, "-o", "verbose", "-v", cwd=tmp_path)
    assert "wrote verbose/day-03/readings.csv" in said and "\x1b" not in said  # no bar beside it
    coloured = {**os.environ, "FORCE_COLOR": "1"}  # as a cell of a notebook has it
    piped = subprocess.run(
        [*simulate, "-o", "piped"], cwd=tmp_path, env=coloured, capture_output=True, text=True
    )
    assert piped.stderr == "" and piped.stdout.startswith("3 sessions")


def test_compiling_is_told_once_and_only_where_something_is_compiled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(compiler, "_cached", False)  # else it is compiled once on this machine
    told: list[str] = []
    jit.call_at_compiling(lambda: told.append("compiling"))

    @jit.jit
    def doubled(x: float) -> float:
        return 2 * x

    @jit.jit
    def halved(x: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
        return x / 2

    assert told == []
    doubled(1.0), halved(np.ones(2))
    assert told == ["compiling"]
    doubled(2.0)
    assert told == ["compiling"]


@pytest.mark.slow
def test_the_first_calculation_on_a_machine_says_that_it_compiles(tmp_path: Path) -> None:
    armd = (sys.executable, "-m", "armd")
    subprocess.run(
        [*armd, "simulate", "--session", "isothermal", "-o", "m"],
        cwd=tmp_path, check=True, capture_output=True,
    )  # fmt: skip
    correct = (*armd, "correct", "m/first/readings.csv", "--arm", "m/arm.toml", "-o")
    cold = {"ARMD_WITHOUT_LIBRARY": "1", "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for name, compiles in (("first.csv", True), ("second.csv", False)):
        out, said = on_a_terminal(*correct, name, cwd=tmp_path, **cold)
        assert ("compiling for this machine, once" in said) == compiles
        assert out == f"{name}: 160 points\n"

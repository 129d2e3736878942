"""Where modules that only POSIX has are missing, as on Windows: offline work and subscribers run,
`armd run` says what it needs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import armd

BLOCKED = ("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty")
#: What else `os` and `signal` have on POSIX alone, of what armd or its libraries might ask for.
ATTRIBUTES = ("O_CLOEXEC", "O_NOFOLLOW", "O_NONBLOCK", "O_NOCTTY", "pathconf", "sched_getaffinity")
PROLOGUE = f"""
import os, signal, sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name in {BLOCKED!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

for name in {BLOCKED!r}:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Blocked())
for name in {ATTRIBUTES!r}:
    delattr(os, name)
del signal.SIGHUP
"""
COMMAND = PROLOGUE + "from armd.daemon.cli import main; sys.exit(main(sys.argv[1:]))"
SIMULATE = PROLOGUE + "from armd.simulator.__main__ import main; sys.exit(main(sys.argv[1:]))"
DECODE = (
    PROLOGUE
    + """
import json
import armd
import numpy as np
import armd.client, armd.received

payload = bytes.fromhex(json.load(sys.stdin))
points = armd.Point.from_array(np.frombuffer(payload, armd.POINT))
print(json.dumps([[point.seq, list(point.position_mm)] for point in points]))
"""
)


def run(program: str, *arguments: object, text: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        input=text, capture_output=True, text=True, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sessions of the simulator, made without these modules."""
    folder = tmp_path_factory.mktemp("measured")
    for session in ("demo", "verify"):
        done = run(SIMULATE, "--session", session, "--seed", 3, "-o", folder / session, "-q")
        assert (done.returncode, done.stderr) == (0, "")
    return folder


def demo_sessions(measured: Path) -> list[Path]:
    return sorted(path.parent for path in measured.glob("demo/*/session.toml"))


@pytest.mark.slow
def test_calibrate_and_verify(measured: Path) -> None:
    arm, calibration = measured / "demo/arm.toml", measured / "calibration.json"
    sessions = demo_sessions(measured)
    done = run(COMMAND, "calibrate", *sessions, "--arm", arm, "-o", calibration, "-v")
    assert done.returncode == 0, done.stderr
    assert "s of processor time" in done.stderr and "MB of memory" not in done.stderr
    assert json.loads(calibration.read_text())["arm"]
    tests = measured / "verify"
    verified = run(
        COMMAND, "verify", next(tests.rglob("session.toml")).parent,
        "--arm", tests / "arm.toml", "--calibration", calibration,
    )  # fmt: skip
    assert verified.returncode == 0 and "decision rule" in verified.stdout, verified.stderr


@pytest.mark.slow
def test_diagnose(measured: Path) -> None:
    arm = measured / "demo/arm.toml"
    diagnosed = run(COMMAND, "diagnose", *demo_sessions(measured)[:2], "--arm", arm)
    assert diagnosed.returncode in (0, 1), diagnosed.stderr


def test_a_subscriber_decodes_points() -> None:
    points = np.zeros(3, armd.POINT)
    points["seq"] = [1, 2, 3]
    points["position_mm"] = np.arange(9).reshape(3, 3) / 8
    done = run(DECODE, text=json.dumps(points.tobytes().hex()))
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == [
        [int(point["seq"]), point["position_mm"].tolist()] for point in points
    ]


@pytest.mark.parametrize("command", ["run", "doctor"])
def test_what_needs_linux_says_so_in_one_line(command: str) -> None:
    done = run(COMMAND, command, "armd.toml")
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"armd: {command}: found a system without Python's module ")
    assert line.endswith(", expected Linux")


def test_the_list_of_commands_is_there() -> None:
    done = run(COMMAND, "--help")
    assert done.returncode == 0 and "calibrate" in done.stdout

"""What `import armd` costs, and that all its names are there."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

import armd

OFFLINE = [
    "read_arm", "read_calibration", "read_session", "make_session", "calibrate", "evaluate",
    "diagnose", "verify", "design", "Model", "Corrector",
]  # fmt: skip
PROBE = "import sys, armd; print(*sorted({m.partition('.')[0] for m in sys.modules}), *dir(armd))"


def test_importing_it_loads_nothing_that_takes_long() -> None:
    began_s = time.perf_counter()
    command = [sys.executable, "-I", "-X", "importtime", "-c", PROBE]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    print(f"a process that imports armd: {time.perf_counter() - began_s:.2f} s")
    words = done.stdout.split()
    heavy = {"numba", "pyarrow", "zenoh", "matplotlib", "scipy", "pydantic", "numpy"}
    assert not heavy & set(words)
    assert {*OFFLINE, "ArmModel", "Calibration", "Session", "connect"} <= set(words)
    line = next(line for line in done.stderr.splitlines() if line.endswith("| armd"))
    assert int(line.split("|")[1]) < 200_000  # µs, all imports within included


def test_every_name_of_the_offline_half_is_documented() -> None:
    for name in OFFLINE:
        assert name in armd.__all__
        text = getattr(armd, name).__doc__
        assert ">>>" in text and "Raises `" in text, name


def test_the_subscriber_alone_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "armd.offline", None)
    monkeypatch.delitem(sys.modules, "armd.offline.model", raising=False)
    monkeypatch.delitem(vars(armd), "Model", raising=False)
    with pytest.raises(ImportError, match="armd-client: install armd"):
        armd.Model  # noqa: B018

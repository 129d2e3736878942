"""`tests/twice.py`, which gives a test with deadlines a second run: when it does, and when not."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

TWICE = Path(__file__).parents[1] / "twice.py"
#: Fails when it is run for the first time.
ONCE = """\
from pathlib import Path
import pytest

@pytest.mark.parametrize("name", {names})
def test_something(name):
    run_before = Path(name)
    assert run_before.exists() or run_before.write_text("") != 0
"""
EVER = "def test_something():\n    assert False\n"


def ran(folder: Path, where: str, test: str) -> subprocess.CompletedProcess[str]:
    file = folder / where
    file.parent.mkdir(parents=True)
    file.write_text(test)
    (folder / "pyproject.toml").write_text("[tool.pytest.ini_options]\n")
    asked = [sys.executable, str(TWICE), "tests"]
    plain = os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    return subprocess.run(asked, cwd=folder, env=plain, capture_output=True, text=True, check=False)


def test_who_passes_alone_has_passed_and_is_named(tmp_path: Path) -> None:
    done = ran(tmp_path, "tests/daemon/test_it.py", ONCE.format(names=["one", "an other"]))
    assert done.returncode == 0, done.stdout
    assert "armd: 2 failed beside other tests and run once more, alone" in done.stdout
    assert done.stdout.endswith(
        "armd: passed alone, though not beside other tests:\n"
        "  tests/daemon/test_it.py::test_something[one]\n"
        "  tests/daemon/test_it.py::test_something[an other]\n"
    )


@pytest.mark.parametrize(
    ("where", "test", "runs"),
    [
        ("tests/daemon/test_it.py", EVER, 2),
        ("tests/estimate/test_it.py", ONCE.format(names=["one"]), 1),
        ("tests/daemon/test_it.py", ONCE.format(names=list("abcde")), 1),
        ("tests/daemon/test_it.py", "import what_nobody_wrote\n", 1),
    ],
    ids=["fails again", "only computes", "more than a few", "not collected"],
)
def test_who_fails_has_failed(tmp_path: Path, where: str, test: str, runs: int) -> None:
    done = ran(tmp_path, where, test)
    assert done.returncode != 0
    assert done.stdout.count("test session starts") == runs
    assert "passed alone" not in done.stdout

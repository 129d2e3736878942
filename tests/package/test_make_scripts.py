"""Scripts that only `make` starts import what is there: a renamed module is not found a week on."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from support.selection import parametrize_default

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted(
    path
    for path in set(re.findall(r"tests/[\w/]+\.py", (ROOT / "Makefile").read_text()))
    if not Path(path).name.startswith(("test_", "conftest"))
)
LOAD = "import runpy, sys; sys.path.insert(0, sys.argv[2]); runpy.run_path(sys.argv[1])"


def test_make_starts_several_and_each_finds_the_helpers() -> None:
    assert len(SCRIPTS) > 8
    lines = (ROOT / "Makefile").read_text().splitlines()
    starts = [line for line in lines if re.search(r"(python|\)) tests/[\w/]+\.py", line)]
    assert len(starts) > 8
    assert [line for line in starts if "$(SCRIPT) tests/" not in line] == []
    assert "SCRIPT := PYTHONPATH=tests $(BIN)/python" in lines


@parametrize_default("script", SCRIPTS)
def test_a_script_of_make_imports(script: str) -> None:
    path = ROOT / script
    done = subprocess.run(
        [sys.executable, "-c", LOAD, str(path), str(path.parent)],
        env=os.environ | {"PYTHONPATH": str(ROOT / "tests")},
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr

"""The page on adding to armd: its files exist, and what it shows is added by script."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from support.pages import page_path

ROOT = Path(__file__).parents[2]
ROOMS = ("drivers", "compensation", "daemon", "simulator")
TOY_CAUSE = "compensation/effects/mechanical/viscous_drag.py"


def text(name: str) -> str:
    return page_path(name).read_text(encoding="utf-8")


def cause() -> str:
    (source,) = re.findall(r"```python\n(.*?)```", text("extend"), re.DOTALL)
    return str(source)


def test_a_cause_is_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The catalogue finds it in its room; its candidates are the arm's joints."""
    from armd.compensation.effects import catalogue, mechanical

    path = tmp_path / Path(TOY_CAUSE).name
    path.write_text(cause(), encoding="utf-8")
    for words in (["format", "--check"], ["check"]):
        command = [sys.executable, "-m", "ruff", *words, "--config", ROOT / "pyproject.toml", path]
        assert subprocess.run(command).returncode == 0
    monkeypatch.setattr(mechanical, "__path__", [*mechanical.__path__, str(tmp_path)])
    found = {effect.cause: effect for effect in catalogue._load_effects()}
    assert set(found) == {*catalogue.CATALOGUE, "viscous_drag"}
    facts = type("Facts", (), {"rates": True, "joints": range(1, 5)})()
    candidates = list(found["viscous_drag"].candidates(facts))
    assert [str(candidate.location) for candidate in candidates] == [
        f"joint {k}" for k in range(1, 5)
    ]
    assert candidates[2].columns[0].terms[0].parameter == "theta_3"
    facts.rates = False
    assert not list(found["viscous_drag"].candidates(facts))


def patched(folder: Path) -> None:
    """Apply the page's diff: each hunk's context and additions by their lines, in order."""
    (diff,) = re.findall(r"```diff\n(.*?)```", text("extend"), re.DOTALL)
    for part in re.split(r"^--- a/.*\n\+\+\+ b/", diff, flags=re.MULTILINE)[1:]:
        name, hunks = part.split("\n", 1)
        path = folder / name
        source = path.read_text(encoding="utf-8")
        for hunk in re.split(r"^@@.*\n", hunks, flags=re.MULTILINE)[1:]:
            lines = [line or " " for line in hunk.rstrip("\n").split("\n")]
            old = "".join(line[1:] + "\n" for line in lines if line[0] in " -")
            new = "".join(line[1:] + "\n" for line in lines if line[0] in " +")
            assert source.count(old) == 1, (name, old)
            source = source.replace(old, new)
        path.write_text(source, encoding="utf-8")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_scripted_addition_of_both_passes_lint_and_tests(tmp_path: Path) -> None:
    """In a copy of the tree, which is made importable as the wheel would be."""
    tree = tmp_path / "tree"
    for name in ("armd", *ROOMS, "tests"):
        ignored = shutil.ignore_patterns("__pycache__", "data" if name == "tests" else "-")
        shutil.copytree(ROOT / name, tree / name, symlinks=True, ignore=ignored)
    shutil.copy(ROOT / "pyproject.toml", tree)
    (tree / TOY_CAUSE).write_text(cause(), encoding="utf-8")
    patched(tree)
    environment = os.environ | {"PYTHONPATH": str(tree)}

    def run(*words: str) -> None:
        done = subprocess.run(
            [sys.executable, "-m", *words],
            cwd=tree, env=environment, capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]

    # Types of the cause alone, against the package installed: that of the copy takes minutes.
    typed = [sys.executable, "-m", "mypy", tree / TOY_CAUSE]
    assert subprocess.run(typed, cwd=ROOT).returncode == 0
    run("ruff", "format", "--check", "compensation", "tests/model/test_basis.py")
    run("ruff", "check", "compensation")
    run("pytest", "-q", "tests/model/test_basis.py", "tests/effects/test_catalogue.py")
    run("pytest", "-q", "tests/model/test_model.py", "-k", "each_factor and rate_squared")
    run("pytest", "-q", "tests/effects/test_every_cause.py", "-k", "viscous_drag")

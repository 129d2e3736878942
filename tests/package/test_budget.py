"""What the end of a test run reports: heavy tests, files left out, limits that were not judged."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pytest

from support import punctuality as module
from support.punctuality import Machine, read_waiting_s, take_unjudged
from support.selection import parametrize_default

TESTS = Path(__file__).parents[1]
FILES = {
    "test_work.py": """\
import pytest, time
def test_computes():
    end_s = time.process_time() + 0.3
    while time.process_time() < end_s:
        pass
def test_waits():
    time.sleep(0.4)
@pytest.mark.slow
def test_left_out():
    assert False
def test_is_late(punctuality, monkeypatch):
    monkeypatch.setattr("support.punctuality.read_waiting_s", iter([5.0, 7.0]).__next__)
    with punctuality.watch() as machine:
        pass
    machine.judge(2.5, 1.0, "a daemon stops")
""",
    "test_other.py": """\
import pytest
pytestmark = pytest.mark.slow
def test_left_out():
    assert False
""",
}


@pytest.mark.slow
def test_the_end_of_a_run_reports_what_was_heavy_left_out_and_not_judged(tmp_path: Path) -> None:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "pyproject.toml").write_text(
        '[tool.pytest.ini_options]\nmarkers = ["slow", "serial"]\n'
    )
    command = [sys.executable, "-m", "pytest", "-p", "support.punctuality", "-p", "support.budget"]
    done = subprocess.run(
        [*command, "-m", "not slow", "--processor-limit", "0.2"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(TESTS), "PYTEST_ADDOPTS": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    heavy, _, rest = done.stdout.partition("1 limits not judged")
    assert "more than 0.2 s of processor time" in heavy and "::test_computes" in heavy
    assert "::test_waits" not in heavy
    assert "test_work.py::test_is_late: a daemon stops: took 2.50 s, limit 1 s" in rest
    assert "files without a test in make test: test_other.py\n" in rest


@pytest.mark.parametrize(
    ("judge", "over", "waited_s", "words"),
    [
        (lambda machine: machine.judge(0.9, 1.0, "it"), False, 0.0, ""),
        (lambda machine: machine.judge(1.1, 1.0, "it"), True, 0.2, ""),
        (
            lambda machine: machine.judge(1.1, 1.0, "it"), True, 0.05,
            r"it: took 1\.10 s, limit 1 s, waited 0\.05 s",
        ),
        (lambda machine: machine.judge_lost(0, "points"), False, 0.0, ""),
        (lambda machine: machine.judge_lost(3, "points"), True, 4.0, ""),
        (
            lambda machine: machine.judge_lost(3, "points"), True, 2.0,
            r"points: lost 3, waited 2\.00 of 10\.00 s",
        ),
    ],
)  # fmt: skip
def test_what_is_late_or_lost_fails_unless_the_machine_starved_the_test(
    judge: Callable[[Machine], None], over: bool, waited_s: float, words: str
) -> None:
    machine = Machine()
    machine.waited_s, machine.watched_s = waited_s, 10.0
    with pytest.raises(AssertionError, match=words) if words else nullcontext():
        judge(machine)
    assert bool(take_unjudged()) == (over and not words)


def test_waiting_is_read_from_the_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pressure = tmp_path / "cpu"
    pressure.write_text("some avg10=1.00 avg60=1.00 avg300=1.00 total=2500000\nfull total=0\n")
    monkeypatch.setattr(module, "PRESSURE", tmp_path / "none")
    stolen_s = read_waiting_s()
    monkeypatch.setattr(module, "PRESSURE", pressure)
    assert read_waiting_s() - stolen_s == pytest.approx(2.5, abs=0.1)


def test_all_but_the_first_cases_are_slow() -> None:
    cases = [1, (2, 3), pytest.param(4, marks=pytest.mark.skip, id="four")]
    mark = parametrize_default("case", cases, default=1).mark
    first, second, third = mark.args[1]
    assert first == 1
    assert second.values == ((2, 3),) and [m.name for m in second.marks] == ["slow"]
    assert third.id == "four" and [m.name for m in third.marks] == ["skip", "slow"]
    chosen = parametrize_default("a, b", [(1, 2), (3, 4)], default=[1]).mark.args[1]
    assert chosen[0].values == (1, 2) and chosen[1] == (3, 4)


def test_each_test_file_has_a_name_of_its_own() -> None:
    """Pytest imports them by it; two of one name stop every run."""
    names = [path.name for path in TESTS.rglob("test_*.py")]
    assert not {name for name in names if names.count(name) > 1}

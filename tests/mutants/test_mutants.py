"""Mutations: which places of a source are changed, and how; drawn by a seed; caught by a test."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from mutants.copies import Copy
from mutants.covering import load_covering, order_tests
from mutants.draw import draw_mutants, list_mutants, list_mutants_of
from mutants.judge import CAUGHT, NOT_COVERED, SURVIVED, judge, needs_trial
from mutants.mutant import Mutant
from mutants.names import Names
from mutants.trial import Trial

from support.own_environment import own_environment

CHANGES = {
    "x = a < b": ["x = a <= b"],
    "x = a is not b": ["x = a is b"],
    "x = θ + (  # <\n    a) == b": [  # columns count bytes, comments do not count
        "x = θ - (  # <\n    a) == b", "x = θ + (  # <\n    a) != b",
    ],
    "x = a * b": ["x = a / b"],
    "x -= a": ["x += a"],
    "x = a and b or c": ["x = a or b or c", "x = a and b and c"],
    "x = not a": ["x =  a"],
    "x = [7, 0.0]": ["x = [8, 0.0]", "x = [7, 1.0]"],
    "x = 2.0 if a else b": ["x = 3.0 if a else b", "x = 2.0 if not (a) else b"],
    "def f():\n    return a": ["def f():\n    return None"],
    "if a:\n    f(b)": ["if not (a):\n    f(b)", "if a:\n    pass"],
    "for _ in a:\n    break": ["for _ in a:\n    continue"],
}  # fmt: skip
LEFT_ALONE = [
    "x: Literal[3] = a",
    "def f(a: int = b) -> Literal[3]: ...",
    "if TYPE_CHECKING:\n    x = 3",
    'if __name__ == "__main__":\n    f(3)',
    '"""Of 3 < 4."""',
    'x = "a" + b',
    'x = f"{a + 3}"',
    "x = True",
    "print(3)",
    "_log.info(a, 3)",
    "def f():\n    return None",
]
SOURCE = """from armd.compiled.jit import jit

LIMIT = 3


@jit
def limit_value(x):
    return min(x, LIMIT)


def double(x):
    y = limit_value(x)
    return y * 2


def keep(x):
    assert x < 10
    return x


def triple(x):
    return x * 3
"""
TESTS = """import subprocess, sys
import pytest
from armd.sums import double, keep, triple

@pytest.fixture(scope="module")
def six():
    return double(3)

def test_first(six):
    assert six == 6

def test_second(six):
    assert six > 1

def test_process():
    subprocess.run([sys.executable, "-c", "from armd.sums import keep; assert keep(2) == 2"],
                   check=True)
"""


def write_package(root: Path) -> None:
    for path, text in {"armd/sums.py": SOURCE, "armd/__init__.py": "", "tests/test_sums.py": TESTS,
                       "armd/compiled/__init__.py": "", "pyproject.toml": MARKERS,
                       "armd/compiled/jit.py": "def jit(function):\n    return function\n",
                       "armd/compiled/library.py": LIBRARY}.items():  # fmt: skip
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(text, encoding="utf-8")


MARKERS = '[tool.pytest.ini_options]\nmarkers = ["slow", "serial"]\n'
LIBRARY = 'def hash_sources(): return "0"\ndef name_file(): return "none"\n'


@pytest.mark.parametrize("source", CHANGES)
def test_each_place_is_changed(tmp_path: Path, source: str) -> None:
    (tmp_path / "a.py").write_text(source, encoding="utf-8")
    changed = [mutant.apply_to(source) for mutant in list_mutants_of(tmp_path, "a.py")]
    assert changed == CHANGES[source]


@pytest.mark.parametrize("source", LEFT_ALONE)
def test_what_no_test_can_hold_is_left_alone(tmp_path: Path, source: str) -> None:
    (tmp_path / "a.py").write_text(source, encoding="utf-8")
    assert list(list_mutants_of(tmp_path, "a.py")) == []


def test_a_seed_draws_the_same(tmp_path: Path) -> None:
    write_package(tmp_path)
    (tmp_path / "drivers").mkdir()
    (tmp_path / "armd/drivers").symlink_to("../drivers")
    (tmp_path / "drivers/one.py").write_text("x = 1\n")
    every = list_mutants(tmp_path)
    assert [mutant.path for mutant in every].count("drivers/one.py") == 1
    drawn = draw_mutants(tmp_path, 7, 4)
    assert drawn == draw_mutants(tmp_path, 7, 4) != draw_mutants(tmp_path, 8, 4)
    assert len({mutant.before for mutant in drawn}) == 4 and set(drawn) <= set(every)


def test_a_mutant_is_known_again_where_other_lines_moved() -> None:
    mutant = Mutant("a.py", 2, "constant", "x = 1\n", "x = 2\n")
    assert mutant.apply_to("x = 1\n# new\n\nx = 1\n") == "x = 2\n# new\n\nx = 1\n"
    assert replace(mutant, line=4).apply_to("x = 1\n\nx = 1\n") == "x = 1\n\nx = 2\n"
    assert replace(mutant, line=9).name == mutant.name
    with pytest.raises(LookupError, match=r"a\.py:2"):
        mutant.apply_to("x = 3\n")


def test_a_constant_and_a_compiled_function_stand_in_lines_that_use_them(tmp_path: Path) -> None:
    write_package(tmp_path)
    names = Names(tmp_path, ["armd"])
    in_double = range(12, 13)
    for line, is_compiled in ((3, False), (8, True)):
        owner = names.owner("armd/sums.py", line)
        assert owner is not None and owner.is_compiled == is_compiled
        assert names.stand_in("armd/sums.py", owner) == [("armd/sums.py", in_double)]


def test_the_quickest_of_each_file_come_first() -> None:
    seconds = {"a::x": 0.1, "a::y": 0.2, "b::x": 5.0, "c::x": 0.3}
    assert order_tests(seconds, seconds) == ["a::x", "c::x", "b::x", "a::y"]


@pytest.mark.slow
def test_a_mutant_is_caught_by_a_test_that_runs_its_line(tmp_path: Path) -> None:
    """The whole of it, on a package of one module: coverage by test, then a trial of each kind."""
    root = tmp_path / "copy"
    write_package(root)
    own_environment(root / ".venv")
    (packages,) = root.glob(".venv/lib/python*/site-packages")
    (packages / "a.pth").write_text(f"{root}\n")
    covering = load_covering(tmp_path / "data", Copy(root, tmp_path / "compiled"), workers=1)
    first, second, process = (
        f"tests/test_sums.py::test_{n}" for n in ("first", "second", "process")
    )
    assert covering.run("armd/sums.py", [13]) == {first, second}  # by their fixture
    assert covering.run("armd/sums.py", [17]) == {process}
    assert covering.without_test == set()

    trial = Trial(Copy(root, tmp_path / "compiled"))
    mutants = {(one.line, one.kind): one for one in list_mutants_of(root, "armd/sums.py")}
    outcomes = {
        (3, "constant"): (SURVIVED, ""),
        (13, "arithmetic"): (CAUGHT, first),
        (17, "comparison"): (SURVIVED, ""),
        (18, "return None"): (CAUGHT, process),
        (22, "arithmetic"): (NOT_COVERED, ""),
    }
    verdicts = {place: judge(mutants[place], covering, trial) for place in outcomes}
    assert {place: (one.outcome, one.test) for place, one in verdicts.items()} == outcomes
    assert (root / "armd/sums.py").read_text() == SOURCE

    caught = verdicts[13, "arithmetic"]
    assert not needs_trial(caught, covering, root)
    (root / "tests/test_sums.py").write_text(TESTS.replace("six == 6", "six > 5"))
    assert needs_trial(caught, covering, root)

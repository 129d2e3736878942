"""Every statistic is tested alone: of what decides offline, each module has fast tests that ask it
and nothing above it, or says here by which tests of the whole it is held."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[2]
TESTS = ROOT / "tests"
ROOMS = ("diagnose", "estimate", "interim")
#: Whole diagnoses of simulated and of real arms; here no test of one module.
WHOLE = ("hidden", "real")
HISTORY = "interim/test_interim_history.py"
POINTS = "interim/test_points_over_time.py"
#: Module → the tests that hold it. They write and read whole histories; or stand beside such tests.
HELD_BY = {
    "diagnose/heldout/validated": "hidden/test_borne_out.py",  # by squares made up
    "interim/checks/keeping": HISTORY,
    "interim/points/history": POINTS,
    "interim/points/judge": POINTS,
    "interim/points/page": POINTS,
    "interim/points/result": POINTS,
    "interim/report/judge": HISTORY,
    "interim/report/page": HISTORY,
    "interim/report/result": HISTORY,
    "interim/report/single": "interim/test_checks_gone_wrong.py",
}


def imported(path: Path) -> set[str]:
    """Every module that a file may mean: `from a.b import c` is a.b, and a.b.c if that is one."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def test_each_module_that_decides_is_asked_alone() -> None:
    modules = {
        str(path.relative_to(ROOT / "compensation").with_suffix(""))
        for room in ROOMS
        for path in (ROOT / "compensation" / room).rglob("*.py")
        if path.name != "__init__.py"
    }
    assert len(modules) > 80
    asked: set[str] = set()
    for path in TESTS.rglob("test_*.py"):
        if path.relative_to(TESTS).parts[0] not in WHOLE:
            asked |= imported(path)
    alone = {name for name in modules if f"armd.compensation.{name.replace('/', '.')}" in asked}
    assert sorted(modules - alone - set(HELD_BY)) == []
    assert sorted(alone & set(HELD_BY)) == []  # an exception that is none any more goes
    assert set(HELD_BY) <= modules
    assert all((TESTS / name).is_file() for name in HELD_BY.values())


def test_no_two_test_files_have_one_name() -> None:
    """pytest imports them by their names alone, and refuses the second."""
    names = Counter(path.name for path in TESTS.rglob("test_*.py"))
    assert not [name for name, count in names.items() if count > 1]

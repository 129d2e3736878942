"""Every statistic is tested alone: of each module that decides something offline a fast test names
a function or a class, or it says here by which tests of the whole it is held."""

from __future__ import annotations

import ast
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
    "diagnose/heldout/validation": "hidden/test_borne_out.py",  # by squares made up
    "interim/checks/appending": HISTORY,
    "interim/checks/history": HISTORY,
    "interim/checks/keeping": HISTORY,
    "interim/points/history": POINTS,
    "interim/points/judge": POINTS,
    "interim/points/page": POINTS,
    "interim/points/result": POINTS,
    "interim/report/judge": HISTORY,
    "interim/report/next_check": "interim/test_outcomes.py",
    "interim/report/page": HISTORY,
    "interim/report/result": HISTORY,
    "interim/report/single": "interim/test_checks_gone_wrong.py",
}


def named(path: Path) -> set[str]:
    """Every name of a module that a file uses, as a.b.c: imported itself, or as c of a module."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found, modules = set(), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
            modules |= {
                alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names
            }
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found.add(f"{modules.get(node.value.id)}.{node.attr}")
    return found


def defined(path: Path) -> set[str]:
    """The functions and classes of a module."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    kinds = (ast.FunctionDef, ast.ClassDef)
    return {node.name for node in body if isinstance(node, kinds)}


def test_each_module_that_decides_is_asked_alone() -> None:
    modules = {
        str(path.relative_to(ROOT / "compensation").with_suffix("")): defined(path)
        for room in ROOMS
        for path in (ROOT / "compensation" / room).rglob("*.py")
    }
    modules = {module: names for module, names in modules.items() if names}
    assert len(modules) > 80
    asked: set[str] = set()
    for path in (*TESTS.rglob("test_*.py"), *(TESTS / "support").glob("*.py")):
        if path.relative_to(TESTS).parts[0] not in WHOLE:
            asked |= named(path)
    alone = {
        module
        for module, names in modules.items()
        if any(f"armd.compensation.{module.replace('/', '.')}.{name}" in asked for name in names)
    }
    assert sorted(set(modules) - alone - set(HELD_BY)) == []
    assert sorted(alone & set(HELD_BY)) == []  # an exception that is none any more goes
    assert set(HELD_BY) <= set(modules)
    assert all((TESTS / name).is_file() for name in HELD_BY.values())

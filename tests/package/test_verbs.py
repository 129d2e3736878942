"""A public function begins with a verb of one list (CONTRIBUTING.md, Words)."""

from __future__ import annotations

import ast
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

import armd

ROOT = Path(__file__).parents[2]
ROOMS = ("armd", "drivers", "compensation", "daemon", "simulator")
VERBS = frozenset(
    """
    add adjust allow apply assemble assign calibrate call check choose clear clip close collect
    compare compensate compile compute configure connect convert copy correct count decode
    describe design detect diagnose disable draw drop eliminate enable encode escape estimate
    evaluate explain extend factorise fill find fit flush fold follow format generate get group
    hash identify integrate invert join judge keep limit linearise list load locate lock make
    match measure move name normalise number open order pack parse place plan plant predict
    print project propose raise read reduce refuse remove render replace report require resolve
    rotate run save score select serve set shorten show skip solve split spoil start stop
    subscribe suggest sum take tie unpack unwrap update use validate verify wait warn weigh
    whiten write
    """.split()  # noqa: SIM905
)
#: Conversions, predicates, and what a program begins with.
OTHER_BEGINNINGS = frozenset("to from as is are has may can main".split())  # noqa: SIM905
#: Names that others rely on, or that read as a decorator.
EXEMPT = {
    "joints_dtype": "public: armd/__init__.py",
    "key": "public: armd.keys",
    "sample_dtype": "plug-ins make their rows with it (docs/developer/plugins.md)",
    "joint": "plug-ins' causes: compensation/effects/location.py (docs/developer/extend.md)",
    "link": "likewise",
    "parameter": "likewise",
    "sensors": "likewise",
    "target": "likewise",
    "seconds_of_arc": "plug-ins' causes describe themselves with it",
    "jit": "decorator, which says what a function is, as numba's",
    "inlined": "decorator",
    "unlocked": "decorator",
}
#: Package → how many of its public methods begin with no verb of the list; properties are nouns.
METHODS_LEFT = {"armd": 46, "drivers": 214, "compensation": 245, "daemon": 143, "simulator": 181}


@cache
def read_trees(room: str) -> list[tuple[Path, ast.Module]]:
    """Each file of a room with its syntax tree."""
    return [
        (path, ast.parse(path.read_text(encoding="utf-8")))
        for path in (ROOT / room).rglob("*.py")  # which follows no link
    ]


def list_functions(body: list[ast.stmt]) -> list[str]:
    """The public functions or methods that are defined in a body, properties apart."""
    return [
        node.name
        for node in body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and not node.name.startswith("_")
        and not any("property" in ast.unparse(one) for one in node.decorator_list)
    ]


def has_verb(name: str) -> bool:
    return name.partition("_")[0] in VERBS | OTHER_BEGINNINGS


@pytest.mark.parametrize("room", ROOMS)
def test_functions_begin_with_a_verb(room: str) -> None:
    names = [(path, name) for path, tree in read_trees(room) for name in list_functions(tree.body)]
    assert len(names) > 90
    wrong = [
        f"{path.relative_to(ROOT)}: {name}"
        for path, name in names
        if not has_verb(name) and name not in EXEMPT
    ]
    assert wrong == []


@pytest.mark.parametrize("room", ROOMS)
def test_methods_without_a_verb_become_fewer(room: str) -> None:
    wrong = Counter(
        name
        for _, tree in read_trees(room)
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        for name in list_functions(node.body)
        if not has_verb(name)
    )
    assert wrong.total() <= METHODS_LEFT[room], ", ".join(sorted(wrong))


def test_every_verb_and_every_exemption_is_needed() -> None:
    names = {
        name for room in ROOMS for _, tree in read_trees(room) for name in list_functions(tree.body)
    }
    assert VERBS - {name.partition("_")[0] for name in names} == set()
    assert set(EXEMPT) - names == set()
    assert [name for name in EXEMPT if has_verb(name)] == []
    assert "joints_dtype" in armd.__all__


def test_the_list_finds_what_it_is_for() -> None:
    tree = ast.parse("def residuals(): ...\ndef fit_tip(): ...\ndef is_at_rest(): ...\n")
    assert [name for name in list_functions(tree.body) if not has_verb(name)] == ["residuals"]

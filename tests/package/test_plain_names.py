"""No identifier is a participle, a preposition or an adverb alone (CONTRIBUTING.md, Words).

What is left over from before the rule is counted, by package: a count only falls.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NO_WHOLE_NAME = frozenset(
    """
    alone apart asked at beside bent both borne_out deaf due each far foreseen found given
    held here house kept known least left made many meant more most near odd of one other
    others own plain quieter said seen shown some sure taken there told unlikely voice
    wanted way ways what when where who whole worth
    """.split()  # noqa: SIM905
)
#: Package → how many names it still has that are one of these; none where it is not listed.
LEFT = {
    "armd": 12,  # public: fields of `BadInput` and `Lost`, arguments of `Arm` and `keys`
    "drivers": 2,  # a key of recordings: `_asked`
}
IN_COMPENSATION = sorted(path.parent.name for path in ROOT.glob("compensation/*/__init__.py"))
PACKAGES = [
    *("armd", "drivers", "simulator", "daemon"),
    *(f"compensation/{name}" for name in IN_COMPENSATION),
]


def stored_names(tree: ast.AST) -> Iterator[str]:
    """Yield each name that a module defines: functions, classes, arguments, variables, fields."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def count_vague_names(package: Path) -> Counter[str]:
    """How often each word of the list is a whole name in the files of a package."""
    files = list(package.rglob("*.py"))  # which follows no link
    assert files, package
    return Counter(
        word
        for path in files
        for name in stored_names(ast.parse(path.read_text(encoding="utf-8")))
        if (word := name.strip("_")) in NO_WHOLE_NAME
    )


@pytest.mark.parametrize("package", PACKAGES)
def test_vague_names_become_fewer(package: str) -> None:
    counted = count_vague_names(ROOT / package)
    said = ", ".join(f"{word} {number}" for word, number in counted.most_common())
    assert counted.total() == LEFT.get(package, 0), f"LEFT[{package!r}] = {counted.total()}: {said}"


def test_the_list_finds_what_it_is_for() -> None:
    tree = ast.parse("def told(found, residual_mm):\n    self.own = [at for at in found]\n")
    assert sorted(set(stored_names(tree)) & NO_WHOLE_NAME) == ["at", "found", "own", "told"]

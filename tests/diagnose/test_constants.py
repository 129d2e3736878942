"""What decides in the diagnosis stands in `constants.py`, once, with its unit and why; elsewhere in
`diagnose/` no number stands but −1, 0, 1, 2 and what follows by kind, defaults and arguments of
calls included. A format's digits are text, and no number to this test."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import armd.compensation.diagnose as diagnose
from armd.compensation.diagnose import constants

ROOM = Path(diagnose.__path__[0])
TABLE = ROOM / "constants.py"
PLAIN = (-1, 0, 1, 2)
#: Directions of space and freedoms of a pose: in indices, in shapes, in counts of rows (`3 * n`).
DIMENSIONS = (3, 6)
SHAPED = ("reshape", "zeros", "empty", "eye", "arange", "range", "repeat", "broadcast_to", "normal")
#: As factors and divisors: µm per mm, per cent, degrees in π, seconds in an hour.
UNITS = (1e3, 1e-3, 100, 180.0, 3600.0)


def strange(source: str) -> Iterator[tuple[int, float]]:
    """The line and the value of every number that should stand in the table."""
    tree = ast.parse(source)
    parents = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Constant) or type(node.value) not in (int, float, complex):
            continue
        if node.value not in PLAIN and not _is_exempt(node, parents):
            yield node.lineno, node.value  # type: ignore[misc]


def _is_exempt(node: ast.Constant, parents: dict[ast.AST, ast.AST]) -> bool:
    value, over = node.value, parents[node]
    if isinstance(over, ast.UnaryOp):
        over = parents[over]
    operator = over.op if isinstance(over, ast.BinOp) else None
    if value in UNITS and isinstance(operator, ast.Mult | ast.Div):
        return True
    if value == 1 / 2:  # a half as a factor, or a root
        return isinstance(operator, ast.Mult | ast.Pow)
    if type(value) is not int or value not in DIMENSIONS:
        return False
    return isinstance(operator, ast.Mult | ast.Pow) or _is_of_a_shape(node, parents)


def _is_of_a_shape(node: ast.AST, parents: dict[ast.AST, ast.AST]) -> bool:
    """Whether it stands in an index, or directly or in a tuple among a shape's arguments."""
    while node in parents:
        child, node = node, parents[node]
        if isinstance(node, ast.Subscript) and child is node.slice:
            return True
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else None
            return (node.func.id if isinstance(node.func, ast.Name) else name) in SHAPED
    return False


def test_no_number_that_decides_stands_outside_the_table() -> None:
    found = [
        f"{path.relative_to(ROOM)}:{line}: {value}"
        for path in sorted(ROOM.rglob("*.py"))
        if path != TABLE
        for line, value in strange(path.read_text(encoding="utf-8"))
    ]
    assert found == []


@pytest.mark.parametrize(
    "source",
    ["def f(at=0.05): ...", "max(x, 1e-300)", "x > 3", "x * 0.9", "KNOTS = 8", "f(size=(4, n))",
     "round(x, 3)", "LIMIT = 0.5", "max(x, 1e-3)", "STEPS: int = 6"],
)  # fmt: skip
def test_numbers_that_decide_are_found(source: str) -> None:
    assert list(strange(source))


@pytest.mark.parametrize(
    "source",
    ["x[: 3 * n].reshape(-1, 3)", "np.zeros((n, 6))", "1e3 * mm", "100 * share", "0.5 * x",
     "x ** -0.5", "f'{x:.3g}'", "q * np.pi / 180.0", "np.sum(x, axis=(1, 2))"],
)  # fmt: skip
def test_dimensions_units_and_halves_are_not(source: str) -> None:
    assert not list(strange(source))


def test_every_constant_has_its_reason_and_a_user() -> None:
    lines = TABLE.read_text(encoding="utf-8").splitlines()
    elsewhere = [p for p in ROOM.rglob("*.py") if p != TABLE]
    used = {
        node.id
        for path in (*elsewhere, TABLE)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
    }
    for name in (n for n in vars(constants) if n.isupper()):
        (at,) = (i for i, line in enumerate(lines) if name in _names(line))
        assert "#" in lines[at] or lines[at - 1].startswith("#:"), f"{name}: no reason"
        assert name in used, f"{name}: nobody uses it"


def _names(line: str) -> list[str]:
    """What a line of the table assigns to."""
    if line.startswith("#") or "=" not in line:
        return []
    return [name.strip() for name in line.split("=")[0].split(":")[0].split(",")]


def test_no_more_than_sixty_decide() -> None:
    """Which cause is found, how probable it is, and whether it is written."""
    deciding = TABLE.read_text(encoding="utf-8").split("# --- What ")[1]
    assert deciding.startswith("decides")
    names = [
        target.id
        for node in ast.parse(deciding.partition("\n")[2]).body
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name)
    ]
    assert 50 < len(names) <= 60, len(names)

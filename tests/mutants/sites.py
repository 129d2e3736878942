"""Where a source can be changed: operators, conditions, constants, returns, calls, loops.

Left as they are: annotations, docstrings, texts within f-strings, logging and printing, and what
only a type checker or a program's own start runs.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass

Span = tuple[int, int, int, int]  # line, column, last line, last column; columns in bytes

COMPARED: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.Is: ("is", "is not"),
    ast.IsNot: (r"is\s+not", "is"), ast.In: ("in", "not in"), ast.NotIn: (r"not\s+in", "in"),
}  # fmt: skip
COMPUTED: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: (r"\+", "-"), ast.Sub: ("-", "+"), ast.Mult: (r"\*", "/"), ast.Div: ("/", "*"),
}  # fmt: skip
#: Functions and objects that write for a person.
PRINTED = re.compile(r"_?(print\w*|say|report|log|logger|logging|warnings|LOG)")


@dataclass(frozen=True)
class Change:
    """Bytes of a source and what stands there afterwards."""

    kind: str
    line: int
    column: int
    last_line: int
    last_column: int
    after: str


def list_changes(text: str) -> list[Change]:
    """All that can be made, one at a time, in the order of the source."""
    tree = ast.parse(text)
    source = text.encode().splitlines(keepends=True)
    changes = [
        change
        for node in _walk(tree)
        for change in (*_change_expression(node, source), *_change_statement(node, source))
    ]
    return sorted(changes, key=lambda one: (one.line, one.column, one.last_line, one.kind))


def _walk(node: ast.AST) -> Iterator[ast.AST]:
    """Every node that may be changed."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not _is_left(child):
                yield child
                yield from _walk(child)


def _is_left(node: ast.AST) -> bool:
    """Whether nothing within it may be changed. Python 3.11 misplaces what f-strings contain."""
    if isinstance(node, ast.If):
        return bool({"TYPE_CHECKING", "__name__"} & set(_list_names(node.test)))
    if isinstance(node, ast.Expr):
        value = node.value
        return isinstance(value, ast.Constant) or (isinstance(value, ast.Call) and _prints(value))
    return isinstance(node, ast.JoinedStr)


def _list_names(node: ast.AST) -> Iterator[str]:
    for each in ast.walk(node):
        if isinstance(each, ast.Name):
            yield each.id
        elif isinstance(each, ast.Attribute):
            yield each.attr


def _prints(call: ast.Call) -> bool:
    return any(PRINTED.fullmatch(name) for name in _list_names(call.func))


def _change_expression(node: ast.AST, source: list[bytes]) -> Iterator[Change]:
    match node:
        case ast.Compare():
            operands = [node.left, *node.comparators]
            for i, operator in enumerate(node.ops):
                pattern, after = COMPARED[type(operator)]
                yield from _change_between(
                    "comparison", operands[i], operands[i + 1], pattern, after, source
                )
        case ast.BinOp() if type(node.op) in COMPUTED and not _joins_text(node):
            pattern, after = COMPUTED[type(node.op)]
            yield from _change_between("arithmetic", node.left, node.right, pattern, after, source)
        case ast.BoolOp():
            before, after = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
            for left, right in zip(node.values, node.values[1:], strict=False):
                yield from _change_between("and or", left, right, before, after, source)
        case ast.UnaryOp(op=ast.Not()):
            start = node.lineno, node.col_offset
            yield Change("not dropped", *start, start[0], start[1] + len("not"), "")
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            yield Change("constant", *_span(node), _other_number(number))
        case ast.IfExp():
            yield _negate(node.test, source)


def _change_statement(node: ast.AST, source: list[bytes]) -> Iterator[Change]:
    match node:
        case ast.If(test=test) if not _is_negated(test):
            yield _negate(test, source)
        case ast.AugAssign() if type(node.op) in COMPUTED:
            pattern, after = COMPUTED[type(node.op)]
            yield from _change_between(
                "arithmetic", node.target, node.value, pattern + "=", after + "=", source
            )
        case ast.Return(value=ast.expr() as value) if not _is_none(value):
            yield Change("return None", *_span(node), "return None")
        case ast.Expr(value=ast.Call() | ast.Await()):
            yield Change("call removed", *_span(node), "pass")
        case ast.Break():
            yield Change("loop", *_span(node), "continue")
        case ast.Continue():
            yield Change("loop", *_span(node), "break")


def _change_between(
    kind: str, left: ast.expr, right: ast.expr, pattern: str, after: str, source: list[bytes]
) -> Iterator[Change]:
    """Replace the operator between two operands, which `ast` gives no place."""
    _, _, line, column = _span(left)
    for number in range(line, right.lineno + 1):
        content = source[number - 1].partition(b"#")[0] if number < right.lineno else source[
            number - 1
        ][: right.col_offset]  # fmt: skip
        start = column if number == line else 0
        found_at = re.compile(pattern.encode()).search(content, start)
        if found_at is not None:
            yield Change(kind, number, found_at.start(), number, found_at.end(), after)
            return


def _negate(test: ast.expr, source: list[bytes]) -> Change:
    line, column, last_line, last_column = _span(test)
    lines = source[line - 1 : last_line]
    lines[-1] = lines[-1][:last_column]
    lines[0] = lines[0][column:]
    return Change(
        "condition", line, column, last_line, last_column,
        f"not ({b''.join(lines).decode()})",
    )  # fmt: skip


def _span(node: ast.expr | ast.stmt) -> Span:
    assert node.end_lineno is not None and node.end_col_offset is not None
    return node.lineno, node.col_offset, node.end_lineno, node.end_col_offset


def _other_number(value: float) -> str:
    if isinstance(value, int):
        return str(value + 1)
    return repr(value * 1.5 or 1.0)


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _is_negated(node: ast.expr) -> bool:
    return isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)


def _joins_text(node: ast.BinOp) -> bool:
    """Whether it joins or repeats texts, whose change only ends in a TypeError."""
    return any(
        isinstance(side, ast.JoinedStr)
        or (isinstance(side, ast.Constant) and isinstance(side.value, str | bytes))
        for side in (node.left, node.right)
    )

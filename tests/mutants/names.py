"""What a line of the packages belongs to, and which lines name what it defines.

A constant is computed when its module is imported, and a compiled function runs no line of Python.
No test is seen to run them; the tests that hold them run the lines that name them.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mutants.draw import ROOMS
from mutants.mutant import read_source

COMPILING = {"jit", "inlined", "unlocked"}  # of armd.compiled.jit
Function = ast.FunctionDef | ast.AsyncFunctionDef
Lines = tuple[str, range]  # of a file


@dataclass(frozen=True)
class Owner:
    """Of a statement: where it runs, and the names by which others use what it computes."""

    lines: range  # of the statement, or of the whole function for what stands in its head
    names: tuple[str, ...]  # none within a function that runs as Python
    is_compiled: bool = False


@dataclass
class Source:
    """A file of the packages, as a table of its lines."""

    path: str
    owners: dict[int, Owner] = field(default_factory=dict)
    uses: defaultdict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    imported: set[str] = field(default_factory=set)

    @property
    def module(self) -> str:
        dotted = self.path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        return dotted if dotted.startswith("armd") else f"armd.{dotted}"

    def in_functions(self) -> set[int]:
        return {line for line, owner in self.owners.items() if not owner.names}

    def compiled_statements(self) -> dict[str, set[int]]:
        """On which lines the statements of each compiled function begin."""
        starts: dict[str, set[int]] = {}
        for owner in self.owners.values():
            if owner.is_compiled:
                starts.setdefault(owner.names[0], set()).add(owner.lines.start)
        return starts


def read_file(path: str, text: str) -> Source:
    tree, source = ast.parse(text), Source(path)
    _add_owners(source, tree.body, (), None)
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            source.uses[node.id].append(node.lineno)
        elif isinstance(node, ast.Attribute):
            source.uses[node.attr].append(node.end_lineno or node.lineno)
        elif isinstance(node, ast.ImportFrom) and node.module:
            source.imported |= {node.module, *(f"{node.module}.{one.name}" for one in node.names)}
        elif isinstance(node, ast.Import):
            source.imported |= {one.name for one in node.names}
    return source


def _add_owners(
    source: Source, body: Sequence[ast.stmt], classes: tuple[str, ...], function: str | None
) -> None:
    """Of the statements of a body; *function* is the compiled one around it, "" for another."""
    for statement in body:
        inner = list(_list_bodies(statement))
        first = min((one.lineno for each in inner for one in each), default=0)
        decorators = getattr(statement, "decorator_list", [])
        start = min((one.lineno for one in decorators), default=statement.lineno)
        last = statement.end_lineno or start
        head = range(start, max(first, start + 1) if inner else last + 1)
        defines_function = isinstance(statement, Function) and function is None
        if function is not None:
            owner = Owner(head, (function,) if function else (), bool(function))
        elif defines_function:
            owner = _own_head(statement, range(first, last + 1))
        else:
            owner = Owner(head, (*_list_defined(statement), *classes[-1:]))
        source.owners |= dict.fromkeys(range(start, last + 1), owner)  # inner ones follow
        if isinstance(statement, ast.ClassDef) and function is None:
            classes_inside = (*classes, statement.name)
        else:
            classes_inside = classes
        within = owner.names[0] if owner.is_compiled else "" if defines_function else function
        for each in inner:
            _add_owners(source, each, classes_inside, within)


def _own_head(statement: ast.stmt, body: range) -> Owner:
    assert isinstance(statement, Function)
    decorators = {one.id for one in statement.decorator_list if isinstance(one, ast.Name)}
    if decorators & COMPILING:
        return Owner(body, (statement.name,), True)
    return Owner(body, ())


def _list_bodies(statement: ast.stmt) -> Iterator[list[ast.stmt]]:
    for name in ("body", "orelse", "finalbody"):
        if getattr(statement, name, None):
            yield getattr(statement, name)
    for part in (*getattr(statement, "handlers", ()), *getattr(statement, "cases", ())):
        yield part.body


def _list_defined(statement: ast.stmt) -> Iterator[str]:
    if isinstance(statement, ast.ClassDef):
        yield statement.name
        return
    for node in ast.walk(statement):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


class Names:
    """All sources, and which of their lines stand for a line that no test is seen to run."""

    def __init__(self, root: Path, rooms: Sequence[str] = ROOMS) -> None:
        self.root = root
        paths = [path for room in rooms for path in sorted((root / room).rglob("*.py"))]
        self.sources = {
            path.relative_to(root).as_posix(): read_file(
                path.relative_to(root).as_posix(), read_source(root, str(path))
            )
            for path in paths
        }

    def owner(self, path: str, line: int) -> Owner | None:
        return self.sources[path].owners.get(line)

    def stand_in(self, path: str, owner: Owner) -> list[Lines]:
        """The lines within functions of Python that use what the owner's statement computes."""
        lines: list[Lines] = []
        pending, seen = [(path, name) for name in owner.names], set[tuple[str, str]]()
        while pending:
            where, name = pending.pop()
            if (where, name) in seen:
                continue
            seen.add((where, name))
            for user in self._list_users(where, name):
                source = self.sources[user]
                for line in source.uses[name]:
                    using = source.owners.get(line)
                    if using is None or (line in using.lines and name in using.names):
                        continue
                    if using.names:
                        pending += [(user, each) for each in using.names]
                    else:
                        lines.append((user, using.lines))
        return lines

    def _list_users(self, path: str, name: str) -> Iterator[str]:
        """The file that defines a name, and those that import it or its module."""
        yield path
        module = self.sources[path].module
        for other, source in self.sources.items():
            if other != path and module in source.imported and name in source.uses:
                yield other

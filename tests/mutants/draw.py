"""Mutants drawn by a seed from all places where the packages' sources can be changed."""

from __future__ import annotations

import ast
import random
from collections.abc import Iterator, Sequence
from pathlib import Path

from mutants.mutant import Mutant, read_source
from mutants.sites import Change, list_changes

ROOMS = ("armd", "compensation", "daemon", "drivers", "simulator")


def list_mutants(root: Path, rooms: Sequence[str] = ROOMS) -> list[Mutant]:
    """All of these packages, in the order of their files; a link to another package is none."""
    return [
        mutant
        for room in rooms
        for path in sorted((root / room).rglob("*.py"))
        if not any(parent.is_symlink() for parent in path.parents if parent != root)
        for mutant in list_mutants_of(root, path.relative_to(root).as_posix())
    ]


def list_mutants_of(root: Path, path: str) -> Iterator[Mutant]:
    text = read_source(root, path)
    lines = text.splitlines(keepends=True)
    for change in list_changes(text):
        before = "".join(lines[change.line - 1 : change.last_line])
        yield Mutant(path, change.line, change.kind, before, _change_lines(before, change))


def draw_mutants(root: Path, seed: int, count: int) -> list[Mutant]:
    """Mutants of different lines; a package has as many as its number of places says.

    The same seed draws the same from the same sources.
    """
    order = list_mutants(root)
    random.Random(seed).shuffle(order)
    drawn: dict[tuple[str, str], Mutant] = {}
    for mutant in order:
        if len(drawn) == count:
            break
        lines = (mutant.path, mutant.before)
        if lines not in drawn and _differs(root, mutant):
            drawn[lines] = mutant
    return list(drawn.values())


def _differs(root: Path, mutant: Mutant) -> bool:
    """Whether it is Python, and not the same program."""
    text = read_source(root, mutant.path)
    try:
        changed = ast.parse(mutant.apply_to(text))
    except SyntaxError:
        return False
    return mutant.locate_in(text) == mutant.line and ast.dump(changed) != ast.dump(ast.parse(text))


def _change_lines(before: str, change: Change) -> str:
    """The lines with the change's bytes replaced; columns count bytes, as `ast` does."""
    lines = before.encode().splitlines(keepends=True)
    end = sum(map(len, lines[:-1])) + change.last_column
    content = b"".join(lines)
    return (content[: change.column] + change.after.encode() + content[end:]).decode()

"""A mutant: one place of a source file, changed so that a test should fail."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Mutant:
    """A patch of whole lines.

    It is also found in sources whose other lines moved: where the same lines stand nearest.
    """

    path: str  # from the repository's root
    line: int  # of its first line, from 1
    kind: str
    before: str  # lines, each with its end
    after: str

    @property
    def room(self) -> str:
        return self.path.partition("/")[0]

    @property
    def last_line(self) -> int:
        return self.line + len(self.before.splitlines()) - 1

    @property
    def name(self) -> str:
        """The same for the same change of the same lines, wherever in their file they stand."""
        text = "\0".join((self.path, self.kind, self.before, self.after))
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def locate_in(self, text: str) -> int | None:
        """The line on which the lines to change begin in this text of the file, or None."""
        lines, wanted = text.splitlines(keepends=True), self.before.splitlines(keepends=True)
        starts = range(len(lines) - len(wanted) + 1)
        same = [i + 1 for i in starts if lines[i : i + len(wanted)] == wanted]
        return min(same, key=lambda line: abs(line - self.line), default=None)

    def apply_to(self, text: str) -> str:
        """The changed text. Raises `LookupError` where the lines to change are not in it."""
        line = self.locate_in(text)
        if line is None:
            raise LookupError(f"{self.path}:{self.line}: found other lines, expected {self.before}")
        lines = text.splitlines(keepends=True)
        lines[line - 1 : line - 1 + len(self.before.splitlines())] = [self.after]
        return "".join(lines)

    def describe(self) -> str:
        """Where it is, and its change in one line."""
        before, after = (" ".join(text.split()) for text in (self.before, self.after))
        return f"{self.path}:{self.line}: {self.kind}: {before}  →  {after}"


def read_source(root: Path, path: str) -> str:
    return (root / path).read_bytes().decode("utf-8")

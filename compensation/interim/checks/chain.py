"""The chain of a history's lines, each with the hash of the one before; and its head."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field

from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.schema import Strict, json_data, validate
from armd.files.writing import told

HISTORY, HEAD = "history.jsonl", "head.json"
BEGINNING = "0" * 64


class HistoryLine(Strict):
    """One check, as the history has it."""

    schema_: str = Field(alias="schema", pattern="^armd.interim.check/1$")
    check: int
    name: str
    started: str
    arm: str
    first_unix_s: float
    last_unix_s: float
    folder: str
    files: dict[str, str]  # name → SHA-256
    arm_file: str  # SHA-256
    calibration: str  # SHA-256
    added: str
    previous: str


class Head(Strict):
    """How long the history is."""

    schema_: str = Field(alias="schema", pattern="^armd.interim.head/1$")
    checks: int = Field(ge=0)
    sha256: str


@dataclass(frozen=True)
class HistoryChain:
    """The lines in the order of adding."""

    lines: tuple[HistoryLine, ...] = ()
    hashes: tuple[str, ...] = ()  # each line's SHA-256


def read_chain(folder: Path) -> HistoryChain:
    """The history's lines in the order of adding, none without a history; raises `BadInput` where
    the chain is broken or cut short."""
    path = folder / HISTORY
    with told(folder):
        if folder.exists() and not folder.is_dir():
            raise BadInput(folder, "the history", "a file", "a folder")
    # Before the lines: a check that is added in between makes them more than it says, never less.
    head = _head(folder)
    with told(folder):
        begun = path.exists()
    if not begun:
        # A head of no checks is what a power cut leaves before the first line.
        if head is not None and head.checks > 0:
            raise BadInput(path, "the file", "nothing", f"the history that {HEAD} is of")
        return HistoryChain()
    raw = read_input(path).split(b"\n")
    if raw.pop() != b"":
        raise BadInput(path, f"line {len(raw) + 1}", "its end torn off", "a whole line")
    lines, hashes = [], [BEGINNING]
    for number, text in enumerate(raw, 1):
        where = f"{path}: line {number}"
        line = validate(where, json_data(where, text), HistoryLine)
        if line.previous != hashes[-1] or line.check != number:
            found = "a line that does not follow the one before (edited, or lines are missing)"
            follows = f"the hash {hashes[-1][:16]}… of that line"
            raise BadInput(path, f"line {number}", found, follows)
        hashes.append(hashlib.sha256(text).hexdigest())
        lines.append(line)
    _check_head(folder, head or _head(folder), hashes)
    return HistoryChain(tuple(lines), tuple(hashes[1:]))


def _check_head(folder: Path, head: Head | None, hashes: Sequence[str]) -> None:
    """The head may be behind, after a power cut between two files, and never ahead."""
    path, count = folder / HISTORY, len(hashes) - 1
    if head is None:
        raise BadInput(folder / HEAD, "the file", "nothing", f"the number of lines of {HISTORY}")
    if head.checks > count:
        raise BadInput(path, "the file", f"{count} checks", f"{head.checks}, as {HEAD} has them")
    if hashes[head.checks] != head.sha256:
        found = f"a line {head.checks} of another hash than {HEAD} has"
        raise BadInput(path, f"line {head.checks}", found, "the line that was written")


def _head(folder: Path) -> Head | None:
    path = folder / HEAD
    if not path.exists():
        return None
    return validate(path, json_data(path, read_input(path)), Head)

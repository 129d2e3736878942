"""The chain of a history's lines, each with the hash of the one before; and the history's head."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from pydantic import Field

from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.schema import Strict, load_json_data, validate
from armd.files.writing import explain_os_errors

HISTORY, HEAD = "history.jsonl", "head.json"
#: The last result, for the daemon and for programs.
REPORT = "report.json"
BEGINNING = "0" * 64


class AnyLine(Strict):
    """One check, with the fields that every kind of history has."""

    check: int
    name: str
    started: str
    arm: str
    first_unix_s: float
    last_unix_s: float
    folder: str
    files: dict[str, str]  # name → SHA-256
    added: str
    previous: str


class HistoryLine(AnyLine):
    """A check that is a session."""

    schema_: str = Field(alias="schema", pattern="^armd.interim.check/1$")
    arm_file: str  # SHA-256
    calibration: str  # SHA-256


class PointsLine(AnyLine):
    """A check that is a table of points."""

    schema_: str = Field(alias="schema", pattern="^armd.interim.points/1$")
    artefact: str  # SHA-256
    tip_radius_mm: float = Field(ge=0)


#: The kind of checks in a history, by the schema of its lines.
KINDS = {"armd.interim.check/1": "sessions", "armd.interim.points/1": "tables of points"}
Line = TypeVar("Line", bound=AnyLine)


class Head(Strict):
    """The length of the history and the hash of its last line."""

    schema_: str = Field(alias="schema", pattern="^armd.interim.head/1$")
    checks: int = Field(ge=0)
    sha256: str


@dataclass(frozen=True)
class HistoryChain(Generic[Line]):
    """The lines of a history in the order of adding."""

    lines: tuple[Line, ...] = ()
    hashes: tuple[str, ...] = ()  # each line's SHA-256


def is_of_points(folder: Path) -> bool:
    """Whether the checks of a history are tables of points; False where there is no history."""
    path = folder / HISTORY
    if not path.is_file():
        return False
    first = read_input(path).split(b"\n")[0]
    with suppress(BadInput):
        content = load_json_data(path, first)
        return isinstance(content, dict) and content.get("schema") == "armd.interim.points/1"
    return False


def read_chain(folder: Path) -> HistoryChain[HistoryLine]:
    """Read the lines of a history of sessions; see `read_lines`."""
    return read_lines(folder, HistoryLine)


def read_lines(folder: Path, kind: type[Line]) -> HistoryChain[Line]:
    """Read the history's lines in the order of adding; there are none without a history.

    Raises `BadInput` where the chain is broken or cut short.
    """
    path = folder / HISTORY
    with explain_os_errors(folder):
        if folder.exists() and not folder.is_dir():
            raise BadInput(folder, "the history", "a file", "a folder")
    # Read the head before the lines: a check that is added in between then only makes the lines
    # more than the head counts, never fewer.
    head = _load_head(folder)
    with explain_os_errors(folder):
        begun = path.exists()
    if not begun:
        # A power cut before the first line leaves a head of zero checks.
        if head is not None and head.checks > 0:
            raise BadInput(path, "the file", "nothing", f"the history that {HEAD} is of")
        return HistoryChain()
    raw = read_input(path).split(b"\n")
    if raw.pop() != b"":
        raise BadInput(path, f"line {len(raw) + 1}", "its end torn off", "a whole line")
    lines: list[Line] = []
    hashes = [BEGINNING]
    for number, text in enumerate(raw, 1):
        location = f"{path}: line {number}"
        content = load_json_data(location, text)
        _refuse_other_kind(path, number, content, kind)
        line = validate(location, content, kind)
        if line.previous != hashes[-1] or line.check != number:
            problem = "a line that does not follow the one before (edited, or lines are missing)"
            follows = f"the hash {hashes[-1][:16]}… of that line"
            raise BadInput(path, f"line {number}", problem, follows)
        hashes.append(hashlib.sha256(text).hexdigest())
        lines.append(line)
    _check_head(folder, head or _load_head(folder), hashes)
    return HistoryChain(tuple(lines), tuple(hashes[1:]))


def _refuse_other_kind(path: Path, number: int, content: object, kind: type[AnyLine]) -> None:
    """Raise `BadInput` for a line of another kind of check: a history has one kind."""
    own_kind = KINDS["armd.interim.points/1" if kind is PointsLine else "armd.interim.check/1"]
    schema = content.get("schema") if isinstance(content, dict) else None
    line_kind = KINDS.get(schema, own_kind) if isinstance(schema, str) else own_kind
    if line_kind != own_kind:
        expected = f"checks that are {own_kind}: keep the two kinds in two folders (--history)"
        raise BadInput(path, f"line {number}", f"a history of {line_kind}", expected)


def _check_head(folder: Path, head: Head | None, hashes: Sequence[str]) -> None:
    """Raise `BadInput` if the head is missing, counts more lines than there are, or has another
    hash.

    After a power cut between two files the head may count fewer lines.
    """
    path, count = folder / HISTORY, len(hashes) - 1
    if head is None:
        raise BadInput(folder / HEAD, "the file", "nothing", f"the number of lines of {HISTORY}")
    if head.checks > count:
        raise BadInput(path, "the file", f"{count} checks", f"{head.checks}, as {HEAD} has them")
    if hashes[head.checks] != head.sha256:
        mismatch = f"a line {head.checks} of another hash than {HEAD} has"
        raise BadInput(path, f"line {head.checks}", mismatch, "the line that was written")


def _load_head(folder: Path) -> Head | None:
    path = folder / HEAD
    if not path.exists():
        return None
    return validate(path, load_json_data(path, read_input(path)), Head)

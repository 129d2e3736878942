"""Decides which files a command may overwrite, by the rule of docs/decisions/0016.

A command checks all its outputs with `check_outputs` before it begins. An input of the run is never
overwritten. A file of the kind that the command writes is, because it can be made again. Anything
else needs --force.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from armd.errors import BadInput
from armd.files.writing import check_folder, check_place, find_longest_name, is_same_place

_HEAD_BYTES = 1 << 16
_TAIL_BYTES = 64
SESSION_FILES = ("session.toml", "readings.csv", "readings.parquet")


@dataclass(frozen=True)
class OutputKind:
    """A kind of output, and the test of an existing file by its first 64 kB and its last bytes."""

    name: str
    told_by: Callable[[bytes], bool] | None
    """None: none is ever written over unasked, for it cannot be had again."""


def _json_key(head: bytes, key: str) -> str | None:
    """Return the text of the first `"key": …` of a JSON object, without quotation marks."""
    text = head.decode("utf-8", "replace")
    match = re.search(rf'"{key}"\s*:\s*"?([^",}}\n]*)', text)
    return match[1] if match and text.lstrip().startswith("{") else None


def _is_calibration(head: bytes) -> bool:
    return _json_key(head, "schema") == "armd.calibration/1"


def _is_result(head: bytes) -> bool:
    schema = _json_key(head, "schema") or ""
    ours = schema.startswith("armd.") or _json_key(head, "rms_um") is not None
    return ours and not _is_calibration(head)


def has_columns(*names: str) -> Callable[[bytes], bool]:
    """Return a test whether a table's first line has these columns."""

    def header_has_names(head: bytes) -> bool:
        if head.startswith(b"PAR1"):  # Parquet has its columns at the end
            return True
        line = head.split(b"\n")[0].decode("utf-8-sig", "replace")
        header = next(csv.reader([line]), [])
        return set(names) <= {name.strip() for name in header}

    return header_has_names


def _is_settings(head: bytes) -> bool:
    settings_keys = ("plants", "encoder_eccentricity_arcsec")  # a campaign; a printed arm
    return any(_json_key(head, key) is not None for key in settings_keys)


def _is_truth(head: bytes) -> bool:
    if re.match(rb'\{"seq": \d+, "position_mm": \[[^\]]*\]\}\n', head):
        return True
    return b"\0" in head and not head.startswith((b"\x89MCAP", b"%PDF-"))


CALIBRATION = OutputKind("a calibration", _is_calibration)
RESULT = OutputKind("a result of armd", _is_result)
PAGE = OutputKind(
    "a report of armd", lambda head: b'<meta name="generator" content="armd">' in head
)
#: A comment after the end of a PDF, which readers skip.
PDF_MARK = b"% a report of armd\n"
PDF = OutputKind(
    "a report of armd as PDF", lambda head: head.startswith(b"%PDF-") and head.endswith(PDF_MARK)
)
POINTS = OutputKind("a table of points", has_columns("x_mm", "y_mm", "z_mm", "flags"))
POSES = OutputKind("a table of poses", has_columns("pose", "x_mm"))
RECORDING = OutputKind("a recording", None)
ARM = OutputKind("an arm.toml", None)
SESSION = OutputKind("a session's file", None)
TRUTH = OutputKind("a simulator's truth", _is_truth)
SETTINGS = OutputKind("a simulator's settings", _is_settings)
FAULT_LOG = OutputKind("a simulator's fault log", lambda head: head.startswith(b'{"event": '))


def add_force(parser: argparse.ArgumentParser) -> None:
    """Add the option --force, the same for every command that writes."""
    parser.add_argument(
        "--force",
        action="store_true",
        help="write over whatever stands where an output goes, except over an input",
    )


def check_outputs(
    outputs: Mapping[str, tuple[str | Path | None, OutputKind]],
    inputs: Iterable[str | Path | None],
    force: bool,
) -> None:
    """Raise `BadInput` unless each of *outputs* (option → path, kind) can and may be written.

    *inputs* are the files and session folders that the run reads; paths that are None are skipped.
    """
    read = _files_of(inputs)
    path_by_option: dict[str, Path] = {}
    for option, (name, kind) in outputs.items():
        if name is None:
            continue
        path = Path(name)
        check_place(path)
        if os.path.lexists(path) and not path.is_file():
            continue  # a device or pipe stores nothing
        _check_not_read(path, option, read)
        for earlier_option, earlier_path in path_by_option.items():
            if is_same_place(path, earlier_path):
                raise BadInput(path, option, f"the file of {earlier_option}", "a file of its own")
        path_by_option[option] = path
        if not force:
            _check_kind(path, option, kind)


def check_same(
    path: Path,
    content: bytes | str,
    kind: OutputKind,
    force: bool,
    inputs: Iterable[str | Path | None] = (),
) -> None:
    """Raise `BadInput` if *path* exists with another content than *content*.

    For files that a user may have written or measured. Writing the same content again is harmless.
    """
    check_place(path)
    _check_not_read(path, "the file", _files_of(inputs))
    data = content.encode() if isinstance(content, str) else content
    if not force and path.is_file() and path.read_bytes() not in (b"", data):
        present_file = f"{kind.name} with another content"
        raise BadInput(path, "the file", present_file, "none, or --force to write over it")


def check_output_folder(folder: Path) -> None:
    """Raise `BadInput` unless *folder* can be made, or files can be written in it."""
    if os.path.lexists(folder):
        check_folder(folder)
        return
    parent = next(above for above in folder.absolute().parents if os.path.lexists(above))
    check_folder(parent)
    longest = find_longest_name(parent)
    if any(len(os.fsencode(name)) > longest for name in folder.parts):
        raise BadInput(folder, "the folder", "a name too long for its disk", "a shorter one")


def _check_kind(path: Path, option: str, kind: OutputKind) -> None:
    if not path.exists() or path.stat().st_size == 0:
        return
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
        if path.stat().st_size > _HEAD_BYTES:
            file.seek(-_TAIL_BYTES, os.SEEK_END)
            head += file.read(_TAIL_BYTES)
    if kind.told_by is None or not kind.told_by(head):
        expected = f"a new file{f', or {kind.name} of before' if kind.told_by else ''}"
        raise BadInput(path, option, _describe_file(path, head), f"{expected} (or --force)")


def _describe_file(path: Path, head: bytes) -> str:
    """Describe, in words, the file that exists where an output should go."""
    if head.startswith(b"\x89MCAP"):
        return "a recording, which cannot be had again"
    if path.name in SESSION_FILES:
        return "a session's file"
    if _is_calibration(head):
        return "a calibration"
    if schema := re.search(rb'schema"?\s*[:=]\s*"(armd\.[a-z]+/\d+)"', head):
        return f"a file of {schema[1].decode()}"
    return "a file of another kind"


def _check_not_read(path: Path, option: str, inputs: Iterable[Path]) -> None:
    if any(is_same_place(path, file) for file in inputs):
        raise BadInput(path, option, "an input of this run", "another file")


def _files_of(inputs: Iterable[str | Path | None]) -> list[Path]:
    """List the files that a run reads; of a session folder, those in it."""
    files = [Path(path) for path in inputs if path is not None]
    return files + [path / name for path in files if path.is_dir() for name in SESSION_FILES]

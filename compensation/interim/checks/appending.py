"""Appends lines to a history: first the whole folders of the checks, then the lines, then
the head.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armd.compensation.interim.checks.chain import BEGINNING, HEAD, HISTORY
from armd.files.inputs import read_input
from armd.files.writing import explain_os_errors, flush_folder, write_changed, write_whole

CHECKS = "checks"


@dataclass(frozen=True)
class NewLine:
    """A check that is to be kept."""

    facts: Mapping[str, Any]  # the fields of its line
    folder: str  # within CHECKS
    contents: Mapping[str, bytes]  # of the folder, by file name


def add_checks(
    folder: Path, count: int, new: Sequence[NewLine], common: Mapping[Path, bytes]
) -> None:
    """Append checks to the *count* checks in *folder*; *common* are further files in it.

    The caller has locked the history.
    """
    path = folder / HISTORY
    places = [folder / CHECKS / new_line.folder for new_line in new]
    with explain_os_errors(folder), _undo_unless_reported(places, path):
        for name in (CHECKS, *(str(file.parent) for file in common)):
            (folder / name).mkdir(exist_ok=True)
        for file, data in common.items():
            write_changed(folder / file, data)
        text = read_input(path) if path.exists() else b""
        previous = _hash_last(text)
        added = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        for number, (new_line, place) in enumerate(zip(new, places, strict=True), count + 1):
            line = {
                **new_line.facts,
                "check": number,
                "folder": place.name,
                "files": _keep_check(place, new_line.contents),
                "added": added,
                "previous": previous,
            }
            data = json.dumps(line, ensure_ascii=False).encode()
            previous = hashlib.sha256(data).hexdigest()
            text += data + b"\n"
        # Write a head of zero checks before the first line, so that a history always has a head.
        if not (folder / HEAD).exists():
            _write_head(folder, 0, BEGINNING)
        write_whole(path, text)
    _write_head(folder, count + len(new), previous)


def make_folder_name(started: str, name: str) -> str:
    """Make the name of a check's folder from its start and its name."""
    safe_name = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
    return f"{started.replace(':', '').replace('-', '')}-{safe_name[:80]}"


@contextmanager
def _undo_unless_reported(places: Sequence[Path], history: Path) -> Iterator[None]:
    """Remove the folders of new checks if the block fails (a full disk) before their lines are
    written.

    Whole and partial folders would otherwise fill the disk. If *history* has changed, nothing is
    removed.
    """
    before = history.read_bytes() if history.is_file() else b""
    try:
        yield
    except BaseException:
        with suppress(OSError):
            if (history.read_bytes() if history.is_file() else b"") == before:
                for place in places:
                    shutil.rmtree(_name_part(place), ignore_errors=True)
                    shutil.rmtree(place, ignore_errors=True)
        raise


def _write_head(folder: Path, checks: int, sha256: str) -> None:
    head = {"schema": "armd.interim.head/1", "checks": checks, "sha256": sha256}
    write_whole(folder / HEAD, json.dumps(head) + "\n")


def _hash_last(text: bytes) -> str:
    lines = text.split(b"\n")[:-1]
    return hashlib.sha256(lines[-1]).hexdigest() if lines else BEGINNING


def _keep_check(place: Path, contents: Mapping[str, bytes]) -> dict[str, str]:
    """Write a check's files to *place* and return their hashes."""
    if place.exists():  # begun and not finished: no line refers to it
        shutil.rmtree(place)
    part = _name_part(place)
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    for name, data in contents.items():
        write_whole(part / name, data)
    part.rename(place)
    flush_folder(place.parent)
    return {name: hashlib.sha256(data).hexdigest() for name, data in contents.items()}


def _name_part(place: Path) -> Path:
    """Return the temporary path of a check's folder, from which it is renamed to *place*."""
    return place.with_name(f".{place.name}.part")

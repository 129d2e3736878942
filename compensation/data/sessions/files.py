"""The files of a session's folder."""

from __future__ import annotations

from pathlib import Path

from armd.compensation.data.foreign.table import TABLES
from armd.errors import BadInput
from armd.terminal.counted import format_count
from armd.terminal.suggest import format_names, list_folder, suggest_path

READINGS = ("readings.csv", "readings.parquet")


def check_is_session(folder: Path) -> None:
    """Raise `BadInput` for anything but a session's folder, and suggest one nearby."""
    expected = "a folder with session.toml and readings.csv"
    if not folder.is_dir():
        actual = "a file" if folder.exists() else "nothing"
        if folder.is_file() and (folder.parent / "session.toml").is_file():
            actual, expected = "a file of a session", f"its folder, {folder.parent}"
        elif folder.suffix.lower() in TABLES:
            expected += ": armd import makes one of a table"
        elif not folder.exists():
            siblings = sorted(path.parent.name for path in folder.parent.glob("*/session.toml"))
            expected += suggest_path(folder) or (
                f": there is {format_names(siblings)}" if siblings else ""
            )
        raise BadInput(folder, "the session", actual, expected)
    if (folder / "session.toml").exists():
        return
    below = sorted(path.parent.name for path in folder.glob("*/session.toml"))
    if below:
        actual = f"a folder of {format_count(len(below), 'session')}"
        expected = f"sessions, as {' '.join(str(folder / name) for name in below[:2])}"
        raise BadInput(folder, "the session", actual, expected + " …" * (len(below) > 2))
    if (folder.parent / "session.toml").is_file():
        actual = "a folder within a session"
        raise BadInput(folder, "the session", actual, f"the session, {folder.parent}")
    raise BadInput(
        folder, "the session", f"a folder without session.toml{list_folder(folder)}", expected
    )


def find_readings(folder: Path) -> Path:
    """Return the table of readings in a session's folder; raises `BadInput` unless there is one."""
    present = [folder / name for name in READINGS if (folder / name).exists()]
    if len(present) != 1:
        actual = "both" if present else "neither"
        raise BadInput(folder, " or ".join(READINGS), actual, "one of them")
    return present[0]

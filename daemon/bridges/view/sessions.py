"""Reports and results in the folders of guided measurements, for a browser to read."""

from __future__ import annotations

import re
from http import HTTPStatus
from pathlib import Path
from urllib.parse import quote

from armd.daemon.bridges.view.http import NotServed
from armd.errors import BadInput
from armd.files.inputs import read_input

PREFIX = "/sessions/"
#: A file or folder directly in our folder; such a name cannot lead to another folder.
A_NAME = re.compile(r"[^\W_][\w .+-]{0,79}")
#: Suffix → content type; reports come first.
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".json": "application/json",
    ".csv": "text/csv; charset=utf-8",
    ".toml": "text/plain; charset=utf-8",
}
#: A report is a separate page without scripts, isolated from the live page.
GUARDS = {
    "Content-Security-Policy": "sandbox; default-src 'none'; style-src 'unsafe-inline'; "
    "img-src data:; frame-ancestors 'none'",
}
MOST_BYTES = 64 << 20


def list_results(folder: Path) -> list[dict[str, str]]:
    """List `name` and `path` of each file of a session to read, reports first."""
    order = list(KINDS)
    paths = [path for path in folder.iterdir() if _ours(path)]
    paths.sort(key=lambda path: (order.index(path.suffix), path.name))
    return [
        {"name": path.name, "path": PREFIX + quote(f"{folder.name}/{path.name}")} for path in paths
    ]


def read(folder: Path, path: str) -> tuple[str, bytes]:
    """Return content type and content of `/sessions/SESSION/FILE`; raises `NotServed`."""
    session, _, name = path.removeprefix(PREFIX).partition("/")
    file = folder / session / name
    if "/" in name or not A_NAME.fullmatch(session) or file.parent.is_symlink() or not _ours(file):
        raise NotServed(HTTPStatus.NOT_FOUND, f"found nothing at {path[:100]!r}")
    try:
        return KINDS[file.suffix], read_input(file, MOST_BYTES)
    except BadInput as error:
        raise NotServed(HTTPStatus.NOT_FOUND, str(error)) from error


def _ours(file: Path) -> bool:
    """Return whether *file*, in a session's folder, may be shown."""
    named = A_NAME.fullmatch(file.name) is not None and file.suffix in KINDS
    return named and file.is_file() and not file.is_symlink()

"""What lies in the folders of guided measurements, for a browser to read: reports and results."""

from __future__ import annotations

import re
from http import HTTPStatus
from pathlib import Path
from urllib.parse import quote

from armd.daemon.bridges.view.http import NotServed
from armd.errors import BadInput
from armd.files.inputs import read_input

PREFIX = "/sessions/"
#: Of a file or folder right in ours: no way leads out of it.
A_NAME = re.compile(r"[^\W_][\w .+-]{0,79}")
#: By suffix, the kind that a browser is told; reports come first.
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".json": "application/json",
    ".csv": "text/csv; charset=utf-8",
    ".toml": "text/plain; charset=utf-8",
}
#: A report is a page of its own, without a script, and has no part in this one.
GUARDS = {
    "Content-Security-Policy": "sandbox; default-src 'none'; style-src 'unsafe-inline'; "
    "img-src data:; frame-ancestors 'none'",
}
MOST_BYTES = 64 << 20


def list_results(folder: Path) -> list[dict[str, str]]:
    """Of one session: `name` and `path` of each file to read, reports first."""
    order = list(KINDS)
    paths = [path for path in folder.iterdir() if _ours(path)]
    paths.sort(key=lambda path: (order.index(path.suffix), path.name))
    return [
        {"name": path.name, "path": PREFIX + quote(f"{folder.name}/{path.name}")} for path in paths
    ]


def read(folder: Path, path: str) -> tuple[str, bytes]:
    """Kind and content of `/sessions/SESSION/FILE`; raises `NotServed`."""
    session, _, name = path.removeprefix(PREFIX).partition("/")
    file = folder / session / name
    if "/" in name or not A_NAME.fullmatch(session) or file.parent.is_symlink() or not _ours(file):
        raise NotServed(HTTPStatus.NOT_FOUND, f"found nothing at {path[:100]!r}")
    try:
        return KINDS[file.suffix], read_input(file, MOST_BYTES)
    except BadInput as error:
        raise NotServed(HTTPStatus.NOT_FOUND, str(error)) from error


def _ours(file: Path) -> bool:
    """To be shown: *file* lies in a session's folder."""
    named = A_NAME.fullmatch(file.name) is not None and file.suffix in KINDS
    return named and file.is_file() and not file.is_symlink()

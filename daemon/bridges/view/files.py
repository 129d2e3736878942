"""The page's own files, read once."""

from __future__ import annotations

import gzip
import hashlib
from dataclasses import dataclass
from importlib import resources

KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
}


@dataclass(frozen=True)
class File:
    kind: str
    data: bytes
    packed: bytes
    """The same by gzip."""
    tag: str
    """Of the content: a browser that has it need not have it again."""


class Files:
    """The files by path, such as `/style.css`; `/` is the page."""

    def __init__(self) -> None:
        folder = resources.files("armd.daemon.bridges.view") / "page"
        entries = {f"/{entry.name}": entry for entry in folder.iterdir() if entry.is_file()}
        vendor = folder / "vendor"
        entries |= {f"/vendor/{entry.name}": entry for entry in vendor.iterdir() if entry.is_file()}
        self._files = {
            path: _file(path, entry.read_bytes())
            for path, entry in sorted(entries.items())
            if "." + path.rpartition(".")[2] in KINDS
        }
        self._files["/"] = self._files["/index.html"]
        tags = "".join(file.tag for file in self._files.values())
        self.version = hashlib.sha256(tags.encode()).hexdigest()[:16]

    def get(self, path: str) -> File | None:
        return self._files.get(path)


def _file(path: str, data: bytes) -> File:
    kind = KINDS["." + path.rpartition(".")[2]]
    tag = f'"{hashlib.sha256(data).hexdigest()[:32]}"'
    return File(kind, data, gzip.compress(data, 9, mtime=0), tag)

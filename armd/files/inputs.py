"""Reads files of others safely: only regular files, once, up to a limit of size.

A FIFO would block, a device never ends, and parsing costs many times a file's length in memory.
Each refusal of the system becomes a `BadInput` in words.
"""

from __future__ import annotations

import errno
import hashlib
import logging
import os
import stat
from io import BufferedReader
from pathlib import Path

from armd.errors import BadInput
from armd.files.locking import O_CLOEXEC, O_NONBLOCK
from armd.terminal.suggest import list_folder, suggest_path

#: The largest JSON file: a covariance of 300 parameters takes 2.5 MB.
MOST_JSON_BYTES = 8 << 20
#: The largest TOML file: a thousand targets of an artefact take 100 kB.
MOST_TOML_BYTES = 1 << 18

_log = logging.getLogger(__name__)

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe (FIFO)",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
_REFUSALS = {
    errno.ENOENT: "nothing",
    errno.ENOTDIR: "a file where its path has a folder",
    errno.EACCES: "no permission to read it",
    errno.EPERM: "no permission to read it",
    errno.ELOOP: "a symbolic link that leads back to itself",
    errno.ENAMETOOLONG: "a name too long for this system",
    errno.ENXIO: "a device or socket",
}


def open_input(path: str | Path) -> BufferedReader:
    """Open a regular file for reading, without ever blocking; raises `BadInput`."""
    try:
        # Non-blocking: otherwise opening a FIFO waits for a writer.
        handle = os.open(path, os.O_RDONLY | O_NONBLOCK | O_CLOEXEC)
    except OSError as error:
        raise _refused(path, error) from error
    except ValueError as error:
        raise BadInput(repr(str(path)), "the file", "a zero byte in its name", "a name") from error
    status = os.fstat(handle)
    kind = stat.S_IFMT(status.st_mode)
    if kind != stat.S_IFREG:
        os.close(handle)
        has = list_folder(Path(path)) if kind == stat.S_IFDIR else ""
        raise BadInput(path, "the file", _KINDS.get(kind, "no file") + has, "a regular file")
    _log.info("reading %s, %d bytes", path, status.st_size)
    return os.fdopen(handle, "rb")


def read_input(path: str | Path, at_most: int = MOST_JSON_BYTES) -> bytes:
    """Return the bytes of a regular file, read once.

    Raises `BadInput` for one that cannot be read, is no regular file or has more than *at_most*.
    """
    with open_input(path) as file:
        try:
            content = file.read(at_most + 1)
        except OSError as error:
            raise _refused(path, error) from error
        if len(content) <= at_most:
            return content
        size = os.fstat(file.fileno()).st_size
    raise BadInput(path, "the file", f"{size} bytes", f"{at_most} at most")


def hash_input(path: str | Path) -> str:
    """Return the SHA-256 of a file's bytes, hexadecimal; raises `BadInput`."""
    with open_input(path) as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def check_input(path: str | Path) -> None:
    """Raise `BadInput` unless *path* is a regular file that can be opened.

    For libraries that open it by name.
    """
    open_input(path).close()


def _refused(path: str | Path, error: OSError) -> BadInput:
    reason = _REFUSALS.get(error.errno or 0) or error.strerror or "an error"
    expected = "a file that can be read"
    if reason == "nothing":
        expected = f"an existing file{suggest_path(Path(path))}"
    return BadInput(path, "the file", reason, expected)

"""Writes output files completely or not at all: beside their place, synced, then renamed.

An existing file keeps its owner and permissions. A symbolic link is refused, because another user
may have made it. Devices and pipes are written to, not replaced.
"""

from __future__ import annotations

import errno
import logging
import os
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from armd.errors import ArmdError, BadInput
from armd.files.locking import O_CLOEXEC, O_NOCTTY, O_NONBLOCK

_log = logging.getLogger(__name__)

_MOST_LINKS = 8
_ROOM = {errno.ENOSPC: "no space left on its disk", errno.EDQUOT: "the quota of its disk used up"}
_REFUSALS = {
    errno.ENOENT: "no such folder",
    errno.ENOTDIR: "a file where its path has a folder",
    errno.EACCES: "no permission to write there",
    errno.EPERM: "no permission to write there",
    errno.EROFS: "a read-only disk",
    errno.ENAMETOOLONG: "a name too long for its disk",
    errno.ENXIO: "a pipe that nobody reads",
}


@contextmanager
def replace_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside *path*; on a clean exit it becomes *path*.

    On an exception the temporary file is removed and an existing *path* stays as it was. Raises
    `BadInput` where nothing can be written, the disk is full, or *path* is a symbolic link.
    """
    target = Path(path)
    check_place(target)
    with explain_os_errors(target):
        if _is_stream(target):
            with tempfile.TemporaryDirectory(prefix="armd-") as folder:
                part = Path(folder) / f"stream{target.suffix}"
                yield part
                _pour(part, target)
            return
        # A name of its own: the target's may already have the greatest length.
        part = target.parent / f".armd-{secrets.token_hex(6)}.part"
        earlier = target.stat() if target.exists() else None
        mode = 0o666 if earlier is None else 0o600  # 0o666, less the user's umask
        os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY | O_CLOEXEC, mode))
        try:
            yield part
            if earlier is not None:
                _give(part, earlier)
            with part.open("rb") as file:
                os.fsync(file.fileno())
                size = os.fstat(file.fileno()).st_size
            part.replace(target)
            _log.info("wrote %s, %d bytes", target, size)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
        flush_folder(target.parent)


def flush_folder(folder: Path) -> None:
    """Write a folder's changes (files made, renamed or removed) to the disk."""
    if os.name == "nt":  # Windows opens no folder
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_all(handle: int, data: bytes) -> None:
    """Write all *data*, in as many calls as needed."""
    while data:
        data = data[os.write(handle, data) :]


def write_whole(path: str | Path, content: bytes | str) -> None:
    """Write *content* to *path* completely or not at all; raises like `replace_file`."""
    data = content.encode() if isinstance(content, str) else content
    with replace_file(path) as part:
        part.write_bytes(data)


def write_changed(path: str | Path, content: bytes | str) -> None:
    """Write like `write_whole`, unless *path* has this content: then it need not be writable."""
    data = content.encode() if isinstance(content, str) else content
    target = Path(path)
    with suppress(OSError):
        if target.is_file() and not target.is_symlink() and target.read_bytes() == data:
            return
    write_whole(target, data)


def check_place(path: str | Path) -> None:
    """Raise `BadInput` unless a file can be written at *path*, as far as known in advance."""
    target = Path(path)
    with explain_os_errors(target):
        kind = 0 if _descriptor(target) is not None else stat.S_IFMT(_standing(target))
        match kind:
            case stat.S_IFLNK:
                end = Path(os.path.realpath(target))
                if not _is_stream(target):
                    expected = f"a file: name {end} itself, or remove the link"
                    raise BadInput(target, "the file", f"a symbolic link to {end}", expected)
                return
            case stat.S_IFDIR:
                raise BadInput(target, "the file", "a folder", "a file to write")
            case stat.S_IFBLK | stat.S_IFSOCK:
                kind_in_words = "a disk" if kind == stat.S_IFBLK else "a socket"
                raise BadInput(target, "the file", kind_in_words, "a file to write")
        if not _is_stream(target):
            check_folder(target.parent)
            if len(os.fsencode(target.name)) > find_longest_name(target.parent):
                raise OSError(errno.ENAMETOOLONG, "")
            if kind == stat.S_IFREG and not os.access(target, os.W_OK):
                raise BadInput(target, "the file", "it write-protected", "a file to write")


def find_longest_name(folder: Path) -> int:
    """Return the longest file name in bytes; 255 where the system has no answer (Windows)."""
    return os.pathconf(folder, "PC_NAME_MAX") if hasattr(os, "pathconf") else 255


def check_folder(folder: Path) -> None:
    """Raise `BadInput` unless files can be made in *folder*."""
    with explain_os_errors(folder):
        if not folder.is_dir():
            obstacle = "a file" if folder.exists() else "nothing"
            raise BadInput(folder, "the folder", obstacle, "an existing folder to write in")
        if not os.access(folder, os.W_OK | os.X_OK):
            obstacle = "no permission to write in it"
            raise BadInput(folder, "the folder", obstacle, "a folder to write in")


def is_same_place(path: Path, other_path: Path) -> bool:
    """Return whether two paths are one file: by another name, a link or a hard link."""
    if os.path.realpath(path) == os.path.realpath(other_path):
        return True
    with suppress(OSError):
        return path.samefile(other_path)
    return False


@contextmanager
def explain_os_errors(path: Path) -> Iterator[None]:
    """Convert errors of the system about *path* to `BadInput` in words, within this `with`."""
    try:
        yield
    except (BrokenPipeError, ArmdError):  # a silent arm's time-out is an OSError too
        raise
    except OSError as error:
        number = error.errno or 0
        message = " ".join((error.strerror or str(error) or "an error").split())
        if number in _ROOM:
            raise BadInput(path, "the file", _ROOM[number], "room for it") from error
        reason = _REFUSALS.get(number, message)
        raise BadInput(path, "the file", reason, "a place to write a file") from error
    except ValueError as error:
        if "null" not in str(error):
            raise
        raise BadInput(repr(str(path)), "the file", "a zero byte in its name", "a name") from error


def _standing(path: Path) -> int:
    """Return the mode of the file, link or folder at *path* itself; 0: there is none."""
    try:
        return path.lstat().st_mode
    except FileNotFoundError:
        return 0


def _is_stream(path: Path) -> bool:
    """Return whether *path* is a device or pipe, or the name of an open file."""
    if _descriptor(path) is not None:
        return True
    with suppress(OSError):
        mode = path.stat().st_mode
        return stat.S_ISCHR(mode) or stat.S_ISFIFO(mode)
    return False


def _descriptor(path: Path) -> int | None:
    """Return the number of the open file that *path* names, as /dev/stdout names 1."""
    with suppress(OSError):
        descriptor_folder = os.path.realpath("/proc/self/fd")
        for _ in range(_MOST_LINKS):
            if path.name.isdecimal() and os.path.realpath(path.parent) == descriptor_folder:
                return int(path.name)
            if not path.is_symlink():
                return None
            path = path.parent / path.readlink()
    return None


def _pour(part: Path, stream: Path) -> None:
    number = _descriptor(stream)
    if number is None:
        # Non-blocking: otherwise opening a pipe waits for a reader.
        handle = os.open(stream, os.O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC)
        os.set_blocking(handle, True)
    else:
        if number == sys.stdout.fileno():
            sys.stdout.flush()
        handle = os.dup(number)  # opening it by name would write from its beginning
    with os.fdopen(handle, "wb") as out, part.open("rb") as content:
        shutil.copyfileobj(content, out)


def _give(part: Path, earlier: os.stat_result) -> None:
    """Give *part* the owner, group and permissions of the file that it replaces."""
    mode = stat.S_IMODE(earlier.st_mode)
    try:
        os.chown(part, earlier.st_uid, earlier.st_gid)
    except PermissionError:  # another user's file: our group gets only the rights of others
        mode = mode & ~0o7070 | (mode & 0o007) << 3
    part.chmod(mode)

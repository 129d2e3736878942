"""Output files appear whole or not at all: written beside their place, synced, then renamed.

What stands there already keeps its owner and permissions. A symbolic link is refused, because the
one who made it may not be the one who names it; devices and pipes are written to, not replaced.
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
        # Not named after its target: that name may be as long as names can be.
        part = target.parent / f".armd-{secrets.token_hex(6)}.part"
        earlier = target.stat() if target.exists() else None
        mode = 0o666 if earlier is None else 0o600  # 0o666: less what the user's umask takes away
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
    """What was made, renamed or removed in it is on the disk when this returns."""
    if os.name == "nt":  # which opens no folder
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_all(handle: int, data: bytes) -> None:
    """All of it, in as many calls as that takes."""
    while data:
        data = data[os.write(handle, data) :]


def write_whole(path: str | Path, content: bytes | str) -> None:
    """Write *content* to *path* whole or not at all; raises as `replace_file` does."""
    data = content.encode() if isinstance(content, str) else content
    with replace_file(path) as part:
        part.write_bytes(data)


def write_changed(path: str | Path, content: bytes | str) -> None:
    """As `write_whole`, unless *path* has this content already: then nothing need be writable."""
    data = content.encode() if isinstance(content, str) else content
    target = Path(path)
    with suppress(OSError):
        if target.is_file() and not target.is_symlink() and target.read_bytes() == data:
            return
    write_whole(target, data)


def check_place(path: str | Path) -> None:
    """Raise `BadInput` unless a file can be written at *path*, as far as can be told before."""
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
    """Of a file in it, in bytes; 255 where the system does not tell (Windows)."""
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
    """Whether two paths are one file, by another name, through links or over a hard link."""
    if os.path.realpath(path) == os.path.realpath(other_path):
        return True
    with suppress(OSError):
        return path.samefile(other_path)
    return False


@contextmanager
def explain_os_errors(path: Path) -> Iterator[None]:
    """Within this `with`, what the system refuses of *path* becomes a `BadInput` in words."""
    try:
        yield
    except (BrokenPipeError, ArmdError):  # an arm that does not answer is a time-out, too
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
    """The mode of what stands at *path* itself; 0: nothing."""
    try:
        return path.lstat().st_mode
    except FileNotFoundError:
        return 0


def _is_stream(path: Path) -> bool:
    """Whether *path* is a device or pipe, or the name of an open file."""
    if _descriptor(path) is not None:
        return True
    with suppress(OSError):
        mode = path.stat().st_mode
        return stat.S_ISCHR(mode) or stat.S_ISFIFO(mode)
    return False


def _descriptor(path: Path) -> int | None:
    """The number of the open file that *path* is a name of, as /dev/stdout is of 1."""
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
        # Not blocking: a pipe that nobody reads would else be waited for.
        handle = os.open(stream, os.O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC)
        os.set_blocking(handle, True)
    else:
        if number == sys.stdout.fileno():
            sys.stdout.flush()
        handle = os.dup(number)  # opened by its name, a file would be written from its beginning
    with os.fdopen(handle, "wb") as out, part.open("rb") as content:
        shutil.copyfileobj(content, out)


def _give(part: Path, earlier: os.stat_result) -> None:
    """Owner, group and permissions of the file that *part* replaces."""
    mode = stat.S_IMODE(earlier.st_mode)
    try:
        os.chown(part, earlier.st_uid, earlier.st_gid)
    except PermissionError:  # another's file: our own group gets no more than everybody had
        mode = mode & ~0o7070 | (mode & 0o007) << 3
    part.chmod(mode)

"""A lock for one writer at a time, on an open file or folder; it ends with its handle."""

from __future__ import annotations

import os

#: Flags of `os.open` that only POSIX has; 0 elsewhere.
O_CLOEXEC: int = getattr(os, "O_CLOEXEC", 0)
O_NOFOLLOW: int = getattr(os, "O_NOFOLLOW", 0)
O_NONBLOCK: int = getattr(os, "O_NONBLOCK", 0)
O_NOCTTY: int = getattr(os, "O_NOCTTY", 0)


def lock_file(handle: int, *, wait: bool) -> None:
    """Lock the file or folder that *handle* has open.

    Raises `BlockingIOError` where another process has locked it and *wait* is false. Without
    `fcntl` (Windows) nothing is locked: then only one user may write at a time.
    """
    try:
        import fcntl
    except ImportError:
        return
    fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))

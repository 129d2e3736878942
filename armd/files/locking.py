"""One writer at a time: a lock on an open file or folder, which ends with its handle."""

from __future__ import annotations

import os

#: What only POSIX has of the flags of `os.open`; none elsewhere.
O_CLOEXEC: int = getattr(os, "O_CLOEXEC", 0)
O_NOFOLLOW: int = getattr(os, "O_NOFOLLOW", 0)
O_NONBLOCK: int = getattr(os, "O_NONBLOCK", 0)
O_NOCTTY: int = getattr(os, "O_NOCTTY", 0)


def lock_file(handle: int, *, wait: bool) -> None:
    """Lock what *handle* has open, alone; raises `BlockingIOError` where another has it and *wait*
    is false. Without `fcntl` (Windows) nothing is locked: one user at a time is then the rule."""
    try:
        import fcntl
    except ImportError:
        return
    fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))

"""Waiting for bytes on a descriptor, whatever its number: `select.select` ends at 1023."""

from __future__ import annotations

import select
import time


def has_bytes(descriptor: int, seconds: float) -> bool:
    """Whether something is to be read within *seconds*, or the other end is gone.

    Raises `OSError`. Of the last, broken millisecond only the end is looked at: `poll` counts in
    whole ones.
    """
    waiting = select.poll()
    waiting.register(descriptor, select.POLLIN)
    whole_ms = int(seconds * 1e3)
    if waiting.poll(whole_ms):
        return True
    rest_s = seconds - whole_ms / 1e3
    if rest_s <= 0:
        return False
    time.sleep(rest_s)
    return bool(waiting.poll(0))

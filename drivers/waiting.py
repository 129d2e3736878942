"""Waits for bytes on a descriptor of any number: `select.select` ends at 1023."""

from __future__ import annotations

import select
import time


def has_bytes(descriptor: int, seconds: float) -> bool:
    """Return whether bytes arrive within *seconds*, or the other end is gone.

    Raises `OSError`. `poll` counts whole milliseconds. So the last, partial millisecond is slept,
    and only its end is checked.
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

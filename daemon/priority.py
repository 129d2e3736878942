"""The thread that carries the stream goes first, where the system allows it."""

from __future__ import annotations

import os
from contextlib import suppress


def go_first() -> None:
    """Before every ordinary thread, and after every other real-time one; the calling thread alone,
    what it starts later is ordinary again.

    Without the right to it (LimitRTPRIO= of the unit) all stays as it is, and points are a little
    later: docs/performance.md. So it does on a machine with one processor: Zenoh's threads, which
    send what this one puts, must get their turn there even when this one has much to do.
    """
    if len(os.sched_getaffinity(0)) < 2:
        return
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(1))

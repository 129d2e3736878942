"""The threads that carry the stream go first, where the system allows it."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

#: The lowest real-time priority, the same for both: woken, Zenoh's sending thread runs at once on
#: another processor. Of two priorities the higher one would drive the other thread to a processor
#: where its caches are cold, sample by sample (docs/developer/measured.md).
PRIORITY = 1
#: Zenoh has one; it starts with the first subscriber.
SENDER_NAME = "tx-0"
TASKS = Path("/proc/self/task")


def raise_priority() -> None:
    """Before every ordinary thread, and after most real-time ones; the calling thread alone,
    what it starts later is ordinary again.

    Without the right to it (LimitRTPRIO= of the unit) all stays as it is, and points are a little
    later: docs/developer/measured.md. So it does on a machine with one processor: Zenoh's
    threads, which send what this one puts, must get their turn there even when this one
    has much to do.
    """
    if len(os.sched_getaffinity(0)) < 2:
        return
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))


def raise_sender_priority() -> bool:
    """Zenoh's sending thread too, if the calling thread goes first; no other thread of Zenoh's,
    as others decide on what those have to do. Returns whether that is settled: ask again if not.
    """
    if os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK != os.SCHED_FIFO:
        return True
    with suppress(OSError):  # a thread may end while we look
        for task in TASKS.iterdir():
            if (task / "comm").read_text().strip() == SENDER_NAME:
                with suppress(OSError):  # the right to it may not reach that far
                    os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(PRIORITY))
                return True
    return False

"""Real-time priority for the threads of the stream, where the system allows it."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

#: The lowest real-time priority, equal for both threads: when woken, Zenoh's sending thread runs
#: at once on another processor. With two priorities, the thread with the higher one would move the
#: other to a processor with cold caches at every sample (docs/developer/measured.md).
PRIORITY = 1
#: Zenoh's sending thread, which starts with the first subscriber.
SENDER_NAME = "tx-0"
TASKS = Path("/proc/self/task")


def raise_priority() -> None:
    """Give the calling thread a real-time priority, above all ordinary threads.

    Most real-time threads stay above it, and threads that it starts later are ordinary. Nothing
    changes without permission (LimitRTPRIO= of the unit); then points are a little later:
    docs/developer/measured.md. Nothing changes on a machine with one processor, too: Zenoh's
    threads, which send the points, must get processor time there even when this thread is busy.
    """
    if len(os.sched_getaffinity(0)) < 2:
        return
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))


def raise_sender_priority() -> bool:
    """Give Zenoh's sending thread the same priority, if the calling thread has it.

    No other thread of Zenoh gets it, because other programs decide how much work those have.
    Returns whether this is settled: call it again if not.
    """
    if os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK != os.SCHED_FIFO:
        return True
    with suppress(OSError):  # a thread may end meanwhile
        for task in TASKS.iterdir():
            if (task / "comm").read_text().strip() == SENDER_NAME:
                with suppress(OSError):  # the permission may not include it
                    os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(PRIORITY))
                return True
    return False

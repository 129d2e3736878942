"""`armd simulate`: start the simulator, a separate program with its own options."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn


def replace_process(arguments: Sequence[str]) -> NoReturn:
    """Replace this process by `python -m armd.simulator ARGUMENTS`."""
    sys.stdout.flush()
    _hand_over_interrupts()
    os.execv(sys.executable, [sys.executable, "-P", "-m", "armd.simulator", *arguments])


def _hand_over_interrupts() -> None:
    """Let Ctrl-C end the process from here on, unless it is ignored.

    An interrupt that Python has noted but not raised yet would be lost with this program, and the
    next program would continue.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])

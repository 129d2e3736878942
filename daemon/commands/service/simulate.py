"""`armd simulate`: hands over to the simulator, a program of its own with its own options."""

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
    """From here on Ctrl-C ends the process, unless it is ignored. One that Python has taken note of
    and not raised yet would be lost with this program, and the next one run on."""
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])

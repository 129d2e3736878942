"""Standard output that nobody reads any more."""

from __future__ import annotations

import os
import sys


def hush() -> None:
    """Let the rest of standard output go: its reader has left, or its disk is full."""
    if sys.stdout is not None and sys.stdout is sys.__stdout__:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)

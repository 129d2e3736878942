"""Standard output that nobody reads any more."""

from __future__ import annotations

import os
import sys


def hush() -> None:
    """Let the rest of standard output go: its reader has left, or its disk is full."""
    own = sys.__stdout__
    if own is not None and own is sys.stdout:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, own.fileno())
        os.close(nowhere)

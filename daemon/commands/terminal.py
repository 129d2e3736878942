"""Standard output that nobody reads any more."""

from __future__ import annotations

import os
import sys


def drop_output() -> None:
    """Let the rest of standard output go: its reader has left, or its disk is full."""
    standard_output = sys.__stdout__
    if standard_output is not None and standard_output is sys.stdout:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, standard_output.fileno())
        os.close(nowhere)

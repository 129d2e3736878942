"""Handle a standard output that cannot be written any more."""

from __future__ import annotations

import os
import sys


def drop_output() -> None:
    """Discard the rest of standard output: its reader is gone, or its disk is full."""
    standard_output = sys.__stdout__
    if standard_output is not None and standard_output is sys.stdout:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, standard_output.fileno())
        os.close(nowhere)

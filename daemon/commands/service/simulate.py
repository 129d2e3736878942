"""`armd simulate`: hands over to the simulator, a program of its own with its own options."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import NoReturn


def become(arguments: Sequence[str]) -> NoReturn:
    """Replace this process by `python -m armd.simulator ARGUMENTS`."""
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-P", "-m", "armd.simulator", *arguments])

"""What may stand where a file should: each takes the place of one that is there."""

from __future__ import annotations

import os
from pathlib import Path


def nest(path: Path) -> None:
    """Brackets that no parser follows to their end."""
    path.write_text('{"a": ' + "[" * 1_000_000 + "]" * 1_000_000 + "}")


def loop(path: Path) -> None:
    path.unlink()
    path.symlink_to(path.name)


def fifo(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)

"""Names of the columns of a table of readings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from armd.errors import BadInput
from armd.printable import escape_invisible


def check_header(path: Path, header: Sequence[str]) -> None:
    """Raise `BadInput` for a column that occurs twice, or whose name cannot be read."""
    for name, count in Counter(header).items():
        if count > 1:
            raise BadInput(path, f"column {name}", f"{count} of it", "one")
        if hidden := escape_invisible(name):
            raise BadInput(path, "the header", f"the character {hidden}", "names that can be read")

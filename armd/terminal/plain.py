"""Consoles: for plain text, and for moving displays on a terminal."""

from __future__ import annotations

import sys

from rich.console import Console


def make_plain_console() -> Console:
    """Make a console for text with users' names: `S[/1]` and `:star:` are no markup."""
    return Console(markup=False, emoji=False)


def make_moving_console(*, stderr: bool = False) -> Console:
    """Make a console whose spinners and panels move only on a terminal, even with FORCE_COLOR.

    Jupyter sets FORCE_COLOR for the programs of its cells, and shows each frame on a new line.
    """
    stream = sys.stderr if stderr else sys.stdout
    return Console(stderr=stderr, force_terminal=None if stream.isatty() else False)

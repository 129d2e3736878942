"""Consoles: for text as it stands, and for what moves on a terminal."""

from __future__ import annotations

import sys

from rich.console import Console


def make_plain_console() -> Console:
    """A console for text with names that people chose: `S[/1]` and `:star:` are no markup."""
    return Console(markup=False, emoji=False)


def make_moving_console(*, stderr: bool = False) -> Console:
    """A console whose spinners and panels move on a terminal alone, whatever FORCE_COLOR says.

    Jupyter sets FORCE_COLOR for what its cells start, and shows each frame as a line of its own.
    """
    stream = sys.stderr if stderr else sys.stdout
    return Console(stderr=stderr, force_terminal=None if stream.isatty() else False)

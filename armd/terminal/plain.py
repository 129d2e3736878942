"""What a command prints, as it stands."""

from __future__ import annotations

from rich.console import Console


def plain_console() -> Console:
    """A console for text with names that people chose: `S[/1]` and `:star:` are no markup."""
    return Console(markup=False, emoji=False)

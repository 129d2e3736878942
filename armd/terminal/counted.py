"""A number and its noun."""

from __future__ import annotations


def format_count(n: int, noun: str) -> str:
    """Return `1 reading`, `3 readings`; *noun* is regular."""
    return f"{n} {noun}{'' if n == 1 else 's'}"

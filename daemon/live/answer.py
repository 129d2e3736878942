"""The type of answers to requests to the daemon."""

from __future__ import annotations

from collections.abc import Callable

Respond = Callable[[str, bool], None]
"""Told what was done, and True; or why it was not, and False."""

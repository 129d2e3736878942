"""Waiting for what another thread or process does, with a generous limit."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE_S = 60.0  # two cores, shared

What = TypeVar("What")


def wait_until(
    condition: Callable[[], What], told: object = "", patience_s: float = PATIENCE_S
) -> What:
    """What *condition* gives as soon as it is true; fails with what is *told* then."""
    end_s = time.monotonic() + patience_s
    while not (found := condition()):
        assert time.monotonic() < end_s, f"not within {patience_s} s: {told}"
        time.sleep(0.02)
    return found

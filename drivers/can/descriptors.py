"""Lets python-can wait for descriptors over 1023, for which `select.select` raises.

A daemon with many connections has such descriptors. The modules of a bus get a `select` that then
waits with `poll`. `poll` counts whole milliseconds and is therefore used only then.
"""

from __future__ import annotations

import select
import sys
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, Protocol

import can

MOST_OF_SELECT = 1024  # FD_SETSIZE


class HasDescriptor(Protocol):
    def fileno(self) -> int: ...


Waited = Sequence[HasDescriptor | int]


def wait(
    readers: Waited, writers: Waited, failing: Waited, timeout_s: float | None = None
) -> tuple[list[Any], list[Any], list[Any]]:
    """Wait like `select.select`, for descriptors of any number. Raises `OSError`."""
    if all(
        0 <= _number(descriptor) < MOST_OF_SELECT for descriptor in (*readers, *writers, *failing)
    ):
        return select.select(readers, writers, failing, timeout_s)
    ready: tuple[list[Any], list[Any], list[Any]] = ([], [], [])
    waiting = select.poll()
    masks: dict[int, int] = {}
    events = (select.POLLIN, select.POLLOUT, select.POLLPRI)
    for group, event in zip((readers, writers, failing), events, strict=True):
        for descriptor in group:
            number = _number(descriptor)
            masks[number] = masks.get(number, 0) | event
            waiting.register(number, masks[number])
    ready_masks = dict(waiting.poll(None if timeout_s is None else max(timeout_s, 0.0) * 1e3))
    if any(mask & select.POLLNVAL for mask in ready_masks.values()):
        raise OSError("a closed descriptor")
    ended = select.POLLHUP | select.POLLERR
    for group, event, out in zip((readers, writers, failing), events, ready, strict=True):
        also = ended if event != select.POLLPRI else 0
        out += [
            descriptor
            for descriptor in group
            if ready_masks.get(_number(descriptor), 0) & (event | also)
        ]
    return ready


def remove_descriptor_limit(bus: can.BusABC) -> None:
    """Let the modules that define *bus* wait for descriptors of any number."""
    for kind in type(bus).__mro__:
        module = sys.modules.get(kind.__module__)
        if module is not None and getattr(module, "select", None) is select:
            stand_in = SimpleNamespace(select=wait, error=OSError)
            setattr(module, "select", stand_in)  # noqa: B010


def _number(descriptor: HasDescriptor | int) -> int:
    return descriptor if isinstance(descriptor, int) else descriptor.fileno()

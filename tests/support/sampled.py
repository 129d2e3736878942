"""The samples and events among what a driver or a decoder gives."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from armd.drivers.sample import Event, Item


def rows_of(items: Iterable[Item]) -> np.ndarray:
    """All samples in one array, in their order; an empty one without fields where there is none."""
    arrays = [item for item in items if isinstance(item, np.ndarray)]
    return np.concatenate(arrays) if arrays else np.zeros(0)


def events_of(items: Iterable[Item]) -> list[str]:
    """The kinds of all events."""
    return [item.kind for item in items if isinstance(item, Event)]


class Heard:
    """Of a subclass that adds to `items`."""

    items: list[Item]

    @property
    def samples(self) -> np.ndarray:
        return rows_of(self.items)

    @property
    def seqs(self) -> list[int]:
        return [int(row["seq"]) for row in self.samples]

    @property
    def events(self) -> list[str]:
        return events_of(self.items)

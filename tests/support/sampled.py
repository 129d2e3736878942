"""The samples among what a driver or a decoder gives."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from armd.drivers.sample import Item


def rows_of(items: Iterable[Item]) -> np.ndarray:
    """All samples in one array, in their order; an empty one without fields where there is none."""
    arrays = [item for item in items if isinstance(item, np.ndarray)]
    return np.concatenate(arrays) if arrays else np.zeros(0)

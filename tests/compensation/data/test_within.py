"""Whether a column lies within bounds: as a mask would say, also of what is missing or infinite."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.data.soundness.heat_flow import SensorHeat
from armd.compensation.data.tables.within import LARGEST, is_within


@pytest.mark.parametrize("odd", [0.5, -1.0, 1.0, 1.5, -1.5, np.nan, np.inf, -np.inf])
def test_it_is_what_a_mask_says(odd: float) -> None:
    for values in (np.array([0.0, odd, 0.25]), np.array([odd]), np.zeros(0)):
        assert is_within(values, -1.0, 1.0) == bool(((values >= -1.0) & (values <= 1.0)).all())
        assert is_within(values, -LARGEST, LARGEST) == bool(np.isfinite(values).all())


def test_steady_temperatures_count_as_one_course() -> None:
    """In pieces, steady ones (asked as a whole) and one with a leap (asked row by row)."""
    heat = SensorHeat(20.0)
    assert not heat.impossible(np.array([20.0, 20.5, 21.0]), np.arange(3.0)).any()
    leap = heat.impossible(np.array([21.0, 85.0, 21.1]), np.arange(3.0, 6.0))
    assert leap.tolist() == [False, True, False]
    assert heat.impossible(np.array([85.0, 85.1]), np.arange(6.0, 8.0)).all()
    assert not heat.impossible(np.array([21.2, 21.3]), np.arange(8.0, 10.0)).any()

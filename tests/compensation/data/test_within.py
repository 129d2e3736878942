"""Whether a column lies within bounds: as a mask would say, also of what is missing or infinite."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.data.tables.within import LARGEST, is_within


@pytest.mark.parametrize("odd", [0.5, -1.0, 1.0, 1.5, -1.5, np.nan, np.inf, -np.inf])
def test_it_is_what_a_mask_says(odd: float) -> None:
    for values in (np.array([0.0, odd, 0.25]), np.array([odd]), np.zeros(0)):
        assert is_within(values, -1.0, 1.0) == bool(((values >= -1.0) & (values <= 1.0)).all())
        assert is_within(values, -LARGEST, LARGEST) == bool(np.isfinite(values).all())

"""One prior of sizes: about log-uniform, cut at the largest plausible size of a cause."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.effects.effect import Column
from armd.compensation.effects.sizes import SCALES, compute_broadest_sd, list_sizes


def test_scales_share_one_and_larger_ones_are_less_likely() -> None:
    assert sum(SCALES.values()) == pytest.approx(1.0)
    assert list(SCALES) == sorted(SCALES) and [*SCALES.values()] == sorted(SCALES.values())[::-1]


def test_a_scale_is_cut_at_what_is_plausible() -> None:
    sizes = list(list_sizes(np.array([2.0, 1.0]), np.array([np.inf, 3.0])))
    assert [np.exp(log_share) for log_share, _ in sizes] == pytest.approx(list(SCALES.values()))
    assert [size.tolist() for _, size in sizes] == [
        [2.0, 1.0], [10.0, 3.0], [100.0, 3.0]
    ]  # fmt: skip
    assert compute_broadest_sd(Column("a", "mm", 2.0)) == 100.0
    assert compute_broadest_sd(Column("a", "mm", 1.0, reach=5.0)) == 5.0

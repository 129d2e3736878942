"""The kernel's sine and cosine against numpy's in long double."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.kernel.chain import sincos
from armd.compensation.kernel.memory import BLOCK
from armd.compiled.jit import jit


@jit
def all_of(angle: np.ndarray, found: np.ndarray) -> None:
    sincos(angle, 0, len(angle), 1.0, found, 0)


@pytest.mark.parametrize("reach_rad", [0.8, 3.2, 100.0])
def test_error_is_below_its_word(reach_rad: float) -> None:
    angle = np.linspace(-reach_rad, reach_rad, 999 * BLOCK).reshape(-1, BLOCK)
    angle[0, :9] = np.arange(-4, 5) * (np.pi / 4)
    found = np.empty((2 * len(angle), BLOCK))
    all_of(angle, found)
    exact = angle.astype(np.longdouble)
    # Without a fused multiply-add the reduction rounds as the angle itself was rounded.
    bound = 2e-16 + np.spacing(np.abs(angle)) / 2
    assert (np.abs(found[0::2] - np.sin(exact)) < bound).all()
    assert (np.abs(found[1::2] - np.cos(exact)) < bound).all()

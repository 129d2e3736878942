"""A periodic cubic spline with numpy alone, because a daemon has no scipy.

A test compares it with scipy's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armd.arrays import F64


def compute_curve_pieces(values: Sequence[float]) -> F64:
    """Compute the periodic cubic spline through values at 0, 1/n, … of a turn.

    Return cubics (n, 4) of the rad since the beginning of each piece, lowest power first. The
    second derivatives s solve s₋ + 4s + s₊ = 6(v₋ − 2v + v₊)/h², around the turn: a circulant
    system, which the Fourier transform makes diagonal.
    """
    v, n = np.asarray(values, dtype=np.float64), len(values)
    h = math.tau / n
    bend = 6 * (np.roll(v, 1) - 2 * v + np.roll(v, -1)) / h**2
    wave = np.cos(math.tau * np.arange(n // 2 + 1) / n)
    second = np.fft.irfft(np.fft.rfft(bend) / (4 + 2 * wave), n)
    after = np.roll(second, -1)
    slope = (np.roll(v, -1) - v) / h - h * (2 * second + after) / 6
    return np.stack([v, slope, second / 2, (after - second) / (6 * h)], axis=1)


def evaluate_curve(values: Sequence[float], angle: F64) -> F64:
    """Evaluate the spline of `compute_curve_pieces` at angles (n,) rad."""
    pieces = compute_curve_pieces(values)
    h = math.tau / len(pieces)
    turned = np.mod(angle, math.tau)
    k = np.minimum(np.nan_to_num(turned / h), len(pieces) - 1).astype(np.intp)
    since: F64 = turned - k * h
    a, b, c, d = pieces[k].T
    value: F64 = a + since * (b + since * (c + since * d))
    return value

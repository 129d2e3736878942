"""How far residuals over a variable stand out of noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.predictive.bins import Bins
from armd.compensation.diagnose.predictive.moments import Moments
from armd.compensation.diagnose.predictive.strength import (
    Scatter,
    Strength,
    features,
    lines_together,
    of_pairs,
    strength,
)


def over(kind: Any, values: np.ndarray) -> Bins:
    """Bins of twelve rests over *values* in rising order."""
    starts = np.arange(0, len(values), 12)
    middle = np.add.reduceat(values, starts) / 12
    return Bins(kind, kind, np.arange(len(values)), starts, middle, values=values, kind=kind)


def strength_of(bins: Bins, residual: np.ndarray, joint: float = -np.inf) -> Strength:
    """Of independent residuals of unit variance."""
    drawn = Moments(features(bins), bins.order, bins.starts)
    drawn.add(np.random.default_rng(8).normal(size=(1, len(residual), 4000)))
    values = drawn.sums(residual[None, :, None])[0, :, 0]
    unabsorbed = drawn.unabsorbed(np.ones((1, len(residual))))[0]
    return strength(bins, values, Scatter(drawn.covariance[0], unabsorbed, drawn.draws), joint)


def test_strength_is_of_what_varies_and_does_not_grow_with_the_bins() -> None:
    rng = np.random.default_rng(9)
    values, noise = np.sort(rng.uniform(-1.0, 1.0, 480)), rng.normal(size=480)
    for kind, shape in {
        "temperature": 2.0 * values,
        "angle": 2.0 * np.cos(np.radians(values)),
        "rate": 2.0 * np.sign(values),
        "time": 2.0 * (values > 0.3),
    }.items():
        bins = over(kind, values)
        found, none = strength_of(bins, shape + noise), strength_of(bins, noise)
        assert found.noise_units**2 == pytest.approx((shape**2).sum(), rel=0.15), kind
        assert none.noise_units < 3.5, kind
    flat = strength_of(over("temperature", values), 1.0 + noise)
    assert flat.flat > flat.best - 10.0 and flat.noise_units > 20.0
    names = replace(over("time", values), labels=("a",) * 40, values=None, kind="name")
    loosened = noise + 2.5 * (np.arange(480) // 12 == 7)
    alone = strength_of(names, loosened)
    assert alone.best > 40.0 and strength_of(names, noise).best < 12.0
    many = replace(over("time", values), starts=np.arange(480), labels=("a",) * 480, values=None)
    assert strength_of(many, noise).noise_units < 5.0  # independent, each bin by itself


def test_a_difference_of_two_temperatures_is_of_the_pair() -> None:
    rng = np.random.default_rng(10)
    values = rng.uniform(size=(3, 480))
    bins = []
    for i, own in enumerate(values):
        order = np.argsort(own)
        one = over("temperature", own[order])
        bins.append(replace(one, variable=f"t{i + 1}", order=order))
    residual = 6.0 * (values[0] - 0.6 * values[2]) + rng.normal(size=480)
    drawn = Moments(lines_together(bins, 480), np.arange(480), np.zeros(0, dtype=np.int64))
    drawn.add(rng.normal(size=(1, 480, 4000)))
    sums = drawn.sums(residual[None, :, None])[0, :, 0]
    unabsorbed = drawn.unabsorbed(np.ones((1, 480)))[0]
    pairs = of_pairs(bins, sums, Scatter(drawn.covariance[0], unabsorbed, drawn.draws))
    assert max(pairs, key=lambda name: pairs[name]) == "t1"
    assert pairs["t1"] > 1.2 * strength_of(bins[0], residual[bins[0].order]).best

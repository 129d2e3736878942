"""Waves of two joints' angles together, where trigonometry says what they are."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.effects import rolled
from armd.compensation.effects.effect import Column
from armd.compensation.model.pose_factors import Harmonic

Q = np.random.default_rng(3).uniform(-3.0, 3.0, (50, 3))


def value(column: Column) -> np.ndarray:
    found = np.zeros(len(Q))
    for term in column.terms:
        assert term.parameter == "theta_2"
        wave = np.ones(len(Q))
        for factor in term.basis:
            assert isinstance(factor, Harmonic)
            of = np.sin if factor.kind == "sin" else np.cos
            wave *= of(factor.order * Q[:, factor.joint - 1])
        found += term.coefficient * wave
    return found


@pytest.mark.parametrize(("other", "own", "others"), [(3, 3, 2), (1, 2, -5), (3, 1, -4)])
def test_it_is_one_wave_of_both_angles(other: int, own: int, others: int) -> None:
    facts: Any = SimpleNamespace(joints=(1, 2, 3))
    sign = "+" if others > 0 else "-"
    name = f"{own}q2 {sign} {abs(others)}q{other})"
    (candidate,) = [c for c in rolled.list_candidates(facts) if c.columns[0].name.endswith(name)]
    angle = own * Q[:, 1] + others * Q[:, other - 1]
    sine, cosine = map(value, candidate.columns)
    assert sine == pytest.approx(np.sin(angle)) and cosine == pytest.approx(np.cos(angle))
    assert set(candidate.depends_on) == {"q2", f"q{other}"}

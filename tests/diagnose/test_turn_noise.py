"""The noise of orientations beside that of points, by residuals of known scatter."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.constants import TURN_RATIOS
from armd.compensation.diagnose.noise.turns import compute_fitted_freedom, estimate_turn_ratio
from armd.compensation.diagnose.problem.whitening import compute_turn_ratio
from armd.compensation.estimate.linear.blocks import Blocks, Piece
from support.small_fit import unit_noise

N, RATIO = 400, 0.25
TURNED = np.arange(2 * N) >= N


def residual_of(rng: np.random.Generator, ratio: float) -> np.ndarray:
    """Points that scatter by 1 mm per axis, and behind them orientations, by *ratio* of it."""
    scatter = np.where(TURNED, ratio, 1.0)
    return (scatter[:, None] * rng.normal(size=(2 * N, 3))).ravel()


def test_the_first_ratio_is_that_of_the_middle_ones_whatever_a_few_are() -> None:
    rng = np.random.default_rng(1)
    residual = residual_of(rng, RATIO)
    residual[: 3 * 20] *= 1e4
    assert compute_turn_ratio(residual, TURNED) == pytest.approx(RATIO, rel=0.1)
    assert compute_turn_ratio(residual, np.zeros(2 * N, dtype=bool)) == 1.0
    assert compute_turn_ratio(np.where(np.repeat(TURNED, 3), 1.0, 0.0), TURNED) == TURN_RATIOS[1]


@pytest.mark.parametrize("assumed", [0.1, 1.0])
def test_the_ratio_is_found_from_any_that_was_assumed(assumed: float) -> None:
    """By one step: a variance is a mean of squares, whatever they were weighed by."""
    noise = unit_noise(2 * N)
    whitener = noise.whitener / np.where(TURNED, assumed, 1.0)[:, None, None]
    noise = replace(
        noise, whitener=whitener, turned=TURNED, turn_ratio=assumed, counts=np.ones(2 * N)
    )
    linear: Any = SimpleNamespace(joints=np.zeros((2 * N, 3, 1)))
    residual = residual_of(np.random.default_rng(2), RATIO)
    assert estimate_turn_ratio(noise, linear, residual, 0.0) == pytest.approx(RATIO, rel=0.05)
    # Where a fit took half of the squares, what is left is of twice the variance.
    half = estimate_turn_ratio(noise, linear, residual, 1.5 * N)
    assert half == pytest.approx(np.sqrt(2.0) * RATIO, rel=0.05)


def test_a_fit_takes_of_orientations_as_much_as_columns_that_are_theirs_alone() -> None:
    rng = np.random.default_rng(3)
    rests, columns = np.arange(2 * N), np.arange(5)
    values = rng.normal(size=(2 * N, 3, 5))
    values[~TURNED, :, 3:] = 0.0
    values[TURNED, :, :3] = 0.0  # two columns are the orientations' own
    dense = values.reshape(-1, 5)
    blocks = Blocks(2 * N, 5, (Piece(rests, columns, values),), np.zeros((0, 5)))
    noise = replace(unit_noise(2 * N), turned=TURNED)
    assert compute_fitted_freedom(blocks, np.linalg.inv(dense.T @ dense), noise) == pytest.approx(
        2.0
    )
    assert compute_fitted_freedom(blocks, np.eye(5), unit_noise(2 * N)) == 0.0

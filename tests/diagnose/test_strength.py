"""How far residuals over a variable stand out of noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.predictive.bins import Bins
from armd.compensation.diagnose.predictive.scores import Absorption, Score
from armd.compensation.diagnose.predictive.strength import (
    Misfit,
    Scatter,
    Strength,
    compute_strengths,
    compute_strengths_of_pairs,
    make_features,
    make_lines,
    score_shapes,
)
from armd.compensation.diagnose.predictive.sums import Functions, FunctionSums
from armd.compensation.diagnose.predictive.waves import make_waves
from armd.compensation.estimate.linear.blocks import Piece
from armd.compensation.estimate.linear.linear_model import LinearModel


def over(kind: Any, values: np.ndarray) -> Bins:
    """Bins of twelve rests over *values* in rising order."""
    starts = np.arange(0, len(values), 12)
    middle = np.add.reduceat(values, starts) / 12
    return Bins(kind, kind, np.arange(len(values)), starts, middle, values=values, kind=kind)


def score_of(residual: np.ndarray, absorbed: np.ndarray | None = None) -> tuple[Score, Misfit]:
    """Of independent residuals of unit variance; *absorbed* (n, b): what is fitted freely."""
    n = len(residual)
    columns = np.zeros((n, 0)) if absorbed is None else absorbed
    b = columns.shape[1]
    problem = LinearModel.from_rows([("free", columns, np.full(b, np.inf))])
    taken = problem.project(columns.T @ residual)
    piece = Piece(np.arange(n), np.arange(b), np.zeros((n, 3, b)))
    absorption = Absorption(problem, taken, [piece], [columns])
    left = residual - columns @ problem.solve_amplitudes(columns.T @ residual)
    score = Score(residual, left, np.tile([1.0, 0.0, 0.0], (n, 1)), absorption)
    return score, Misfit(float(left @ left), n - b)


def strength_of(bins: Bins, residual: np.ndarray, joint: float = -np.inf) -> Strength:
    score, misfit = score_of(residual)
    functions = Functions.from_features(make_features(bins), bins, len(residual))
    [(sums, scatter)] = score.sum_over(FunctionSums([functions], [np.arange(len(residual))]))
    [strength] = compute_strengths(
        bins, sums[None], Scatter.stack([scatter]), misfit, np.array([joint])
    )
    return strength


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
        gained = 480 * np.log(1.0 + (shape**2).sum() / 480)
        assert found.noise_units**2 == pytest.approx(gained, rel=0.15), kind
        assert none.noise_units < 3.5, kind
    flat = strength_of(over("temperature", values), 1.0 + noise)
    assert flat.flat > flat.best - 10.0
    assert flat.noise_units**2 == pytest.approx(480 * np.log(2.0), rel=0.15)
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
    score, misfit = score_of(residual)
    lines = FunctionSums([Functions.from_columns(make_lines(bins, 480))], [np.arange(480)])
    [(sums, scatter)] = score.sum_over(lines)
    pairs = compute_strengths_of_pairs(sums, scatter, misfit)
    assert int(np.argmax(pairs)) == 0
    assert pairs[0] > 1.2 * strength_of(bins[0], residual).best


def test_teeth_show_over_the_joint_or_the_neighbour_that_turns_them() -> None:
    rng = np.random.default_rng(11)
    degrees = rng.uniform(-150.0, 150.0, (4, 480))
    angles = []
    for k, own in enumerate(degrees, 1):
        order = np.argsort(own)
        one = over("angle", own[order])
        angles.append(replace(one, variable=f"q{k}", order=order))
    waves, turn, noise = make_waves(angles, 480), np.radians(degrees), rng.normal(size=480)
    for phase, right in ((12 * turn[2], {"q3"}), (7 * (turn[1] - turn[2]), {"q2", "q3"})):
        found = waves.strengths(*_swapped(score_of(3.0 * np.cos(phase) + noise), "q2"))
        first = max(found, key=lambda name: found[name])
        assert first in right and found[first] > 5.0 * abs(found["q1"]), found
    # Of joint 1 neither q2 nor q3 alone turns a wheel by their difference.
    found = waves.strengths(*_swapped(score_of(3.0 * np.cos(7 * (turn[1] - turn[2]))), "q4"))
    assert found["q2"] < 0.0


def _swapped(of: tuple[Score, Misfit], joint: str) -> tuple[Score, str, Misfit]:
    return of[0], joint, of[1]


def test_a_curve_that_is_absorbed_but_for_a_hundredth_counts_by_what_is_left() -> None:
    rng = np.random.default_rng(12)
    line = rng.normal(size=480)
    other = line + 0.1 * rng.normal(size=480)
    score, misfit = score_of(5.0 * line + rng.normal(size=480), other[:, None])
    functions = Functions.from_columns(line[:, None])
    [(sums, scatter)] = score.sum_over(FunctionSums([functions], [np.arange(480)]))
    assert scatter.covariance[0, 0] < 0.02 * scatter.unabsorbed[0]
    assert score_shapes(sums, scatter, misfit) > 80.0

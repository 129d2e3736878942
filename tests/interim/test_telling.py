"""What a check that is not made yet would tell: by brute force on a small stack."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from test_interim_evidence import a_stack

from armd.compensation.interim.changes.change import Change
from armd.compensation.interim.evidence.likelihood import NOISE_WEIGHT
from armd.compensation.interim.report.discrimination import (
    SEAT_MM,
    PredictedCheck,
    choose_best_poses,
    compute_overlap,
    estimate_chance_wrong,
    list_all_scenarios,
    list_numbers,
    predict_checks,
)


def change(cause: int, first: int) -> Change:
    return Change(cause, False, first, first, first, np.nan, 1.0, size=3.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_check_is_foretold_as_all_numbers_together_say(seed: int) -> None:
    """The joint normal of all readings and the check's own, conditioned on the readings."""
    of, _ = a_stack(np.random.default_rng(seed))
    seat = np.random.default_rng(seed).normal(size=(len(of.residual[4]), 3))
    targets = tuple(seat if i == 4 else own for i, own in enumerate(of.targets))
    of = replace(of, targets=targets)
    ways = [(change(0, 2),), (change(1, 3),)]
    measured = [0, 1, 3]  # the third was a bad one
    (told,) = predict_checks(of, ways, measured, [4])
    for number, (one,) in enumerate(ways):
        factors = []
        for i in [*measured, 4]:
            own = of.columns[i][:, of.blocks[one.cause]] * (3.0 if i >= one.first else 0.0)
            factors.append(np.concatenate([of.error_columns[i], own], axis=1))
        together = np.concatenate(factors)
        covariance = np.eye(len(together)) + together @ together.T
        n = len(together) - len(of.residual[4])
        gain = covariance[n:, :n] @ np.linalg.inv(covariance[:n, :n])
        readings = np.concatenate([of.residual[i] for i in measured])
        assert told.mean[number] == pytest.approx(gain @ readings, abs=1e-9)
        left = covariance[n:, n:] - gain @ covariance[:n, n:]
        # All variances share a scale, which the readings tell with the calibration's own word.
        squares = readings @ np.linalg.solve(covariance[:n, :n], readings)
        left *= (NOISE_WEIGHT + squares) / (NOISE_WEIGHT + n)
        left += SEAT_MM**2 * seat @ seat.T
        assert told.covariance[number] == pytest.approx(left, rel=1e-9, abs=1e-9)


def some(rng: np.random.Generator, ways: int, numbers: int) -> PredictedCheck:
    roots = rng.normal(size=(ways, numbers, numbers)) / np.sqrt(numbers)
    return PredictedCheck(
        rng.normal(size=(ways, numbers)), np.eye(numbers) + roots @ roots.transpose(0, 2, 1)
    )


def densities(told: PredictedCheck, share: np.ndarray) -> tuple[np.ndarray, float]:
    """Share × density (W, m, m) of checks of two numbers over a grid, and its cells' size."""
    axis = np.linspace(-9.0, 9.0, 361)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1)
    pairs = zip(share, told.mean, told.covariance, strict=True)
    density = np.array([p * multivariate_normal(m, c).pdf(grid) for p, m, c in pairs])
    return density, (axis[1] - axis[0]) ** 2


@pytest.mark.parametrize("seed", range(4))
def test_the_chance_to_be_wrong_is_the_integral_and_below_the_overlap(seed: int) -> None:
    rng = np.random.default_rng(seed)
    told, share = some(rng, 3, 2), np.array([0.5, 0.3, 0.2])
    density, cell = densities(told, share)
    wrong = 1.0 - float(density.max(axis=0).sum() * cell)
    # Of some 4000 checks drawn: 0.008 is one standard deviation at most.
    assert estimate_chance_wrong(share, np.arange(3), told) == pytest.approx(wrong, abs=0.03)
    overlaps = sum(
        float(np.sqrt(density[i] * density[j]).sum() * cell) for i, j in ((0, 1), (0, 2), (1, 2))
    )
    assert float(compute_overlap(share, told)) == pytest.approx(overlaps, rel=1e-3)
    assert wrong <= overlaps


@pytest.mark.parametrize("seed", range(4))
def test_a_cause_is_all_its_ways_and_what_is_left_out_is_wrong(seed: int) -> None:
    """Two causes of two ways each, which the likeliest ways alone tell better; a fifth of all is
    of causes without a way."""
    rng = np.random.default_rng(seed)
    told, share = some(rng, 4, 2), np.array([0.3, 0.2, 0.2, 0.1])
    of_way = np.array([3, 5, 3, 5])  # numbers of causes, as they come
    density, cell = densities(told, share)
    by_cause = np.array([density[of_way == 3].sum(axis=0), density[of_way == 5].sum(axis=0)])
    wrong = 1.0 - float(by_cause.max(axis=0).sum() * cell)
    assert wrong >= 0.2
    assert estimate_chance_wrong(share, of_way, told) == pytest.approx(wrong, abs=0.03)


def test_ways_share_what_their_cause_is_told_with() -> None:
    """Of a doubtful change the ways that are kept are half of it, of one cause more than of
    another; and some causes have none."""
    _, causes = a_stack(np.random.default_rng(1))
    ways = [(0.6, (change(0, 2),)), (0.2, (change(0, 3),)), (0.2, (change(1, 2),))]
    told = {causes[0].place: 0.4, causes[1].place: 0.3, ("other", "place"): 0.2}
    share, of_way, kept = list_all_scenarios(ways, causes, 0, told)
    assert share == pytest.approx([0.3, 0.1, 0.3])
    assert of_way.tolist() == [0, 0, 1] and kept == [way for _, way in ways]
    share, of_way, kept = list_all_scenarios(ways, causes, 0, {causes[0].place: 0.9})
    assert share == pytest.approx([0.675, 0.225]) and len(kept) == 2


def test_poses_are_chosen_from_the_seats_in_turn_and_the_best_of_each_first() -> None:
    rng = np.random.default_rng(1)
    told, share = some(rng, 2, 3 * 8), np.array([0.6, 0.4])
    pools = [np.arange(4), np.arange(4, 8)]
    chosen, least = choose_best_poses(share, told, pools, 4)
    assert [pose // 4 for pose in chosen] == [0, 1, 0, 1] and len(set(chosen)) == 4
    assert least == pytest.approx(
        float(compute_overlap(share, told.rows(list_numbers(np.array(chosen)))))
    )
    first = [
        float(compute_overlap(share, told.rows(list_numbers(np.array([pose])))))
        for pose in range(4)
    ]
    assert chosen[0] == int(np.argmin(first))


def test_a_stack_of_one_way_leaves_no_doubt() -> None:
    told = some(np.random.default_rng(2), 1, 4)
    assert (
        estimate_chance_wrong(np.ones(1), np.zeros(1, int), told) == 0.0
        and float(compute_overlap(np.ones(1), told)) == 0.0
    )

"""What a check that is not made yet would tell: by brute force on a small stack."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from test_interim_evidence import a_stack

from armd.compensation.interim.changes.change import Change
from armd.compensation.interim.told.telling import (
    SEAT_MM,
    Foretold,
    best_poses,
    chance_wrong,
    foretold,
    numbers_of,
    overlap,
)


def change(cause: int, first: int) -> Change:
    return Change(cause, False, first, first, first, np.nan, 1.0, size=3.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_check_is_foretold_as_all_numbers_together_say(seed: int) -> None:
    """The joint normal of all readings and the check's own, conditioned on the readings."""
    of, causes = a_stack(np.random.default_rng(seed))
    seat = np.random.default_rng(seed).normal(size=(len(of.residual[4]), 3))
    targets = tuple(seat if i == 4 else own for i, own in enumerate(of.targets))
    of = replace(of, targets=targets)
    ways = [(change(0, 2),), (change(1, 3),)]
    measured = [0, 1, 3]  # the third was a bad one
    (told,) = foretold(of, causes, ways, measured, [4])
    for number, (one,) in enumerate(ways):
        factors = []
        for i in [*measured, 4]:
            own = of.columns[i][:, of.blocks[one.cause]] * (3.0 if i >= one.first else 0.0)
            factors.append(np.concatenate([of.known[i], own], axis=1))
        together = np.concatenate(factors)
        covariance = np.eye(len(together)) + together @ together.T
        n = len(together) - len(of.residual[4])
        covariance[n:, n:] += SEAT_MM**2 * seat @ seat.T
        gain = covariance[n:, :n] @ np.linalg.inv(covariance[:n, :n])
        readings = np.concatenate([of.residual[i] for i in measured])
        assert told.mean[number] == pytest.approx(gain @ readings, abs=1e-9)
        left = covariance[n:, n:] - gain @ covariance[:n, n:]
        assert told.covariance[number] == pytest.approx(left, rel=1e-9, abs=1e-9)


def some(rng: np.random.Generator, ways: int, numbers: int) -> Foretold:
    roots = rng.normal(size=(ways, numbers, numbers)) / np.sqrt(numbers)
    return Foretold(
        rng.normal(size=(ways, numbers)), np.eye(numbers) + roots @ roots.transpose(0, 2, 1)
    )


@pytest.mark.parametrize("seed", range(4))
def test_the_chance_to_be_wrong_is_the_integral_and_below_the_overlap(seed: int) -> None:
    """Two numbers a check: the integral over a grid."""
    rng = np.random.default_rng(seed)
    told, share = some(rng, 3, 2), np.array([0.5, 0.3, 0.2])
    axis = np.linspace(-9.0, 9.0, 361)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1)
    pairs = zip(share, told.mean, told.covariance, strict=True)
    density = np.array([p * multivariate_normal(m, c).pdf(grid) for p, m, c in pairs])
    cell = (axis[1] - axis[0]) ** 2
    wrong = 1.0 - float(density.max(axis=0).sum() * cell)
    # A thousand checks are drawn of each way: 0.016 is one standard deviation at most.
    assert chance_wrong(share, told) == pytest.approx(wrong, abs=0.05)
    overlaps = sum(
        float(np.sqrt(density[i] * density[j]).sum() * cell) for i, j in ((0, 1), (0, 2), (1, 2))
    )
    assert float(overlap(share, told)) == pytest.approx(overlaps, rel=1e-3)
    assert wrong <= overlaps


def test_poses_are_chosen_from_the_seats_in_turn_and_the_best_of_each_first() -> None:
    rng = np.random.default_rng(1)
    told, share = some(rng, 2, 3 * 8), np.array([0.6, 0.4])
    pools = [np.arange(4), np.arange(4, 8)]
    chosen, least = best_poses(share, told, pools, 4)
    assert [pose // 4 for pose in chosen] == [0, 1, 0, 1] and len(set(chosen)) == 4
    assert least == pytest.approx(float(overlap(share, told.rows(numbers_of(np.array(chosen))))))
    first = [float(overlap(share, told.rows(numbers_of(np.array([pose]))))) for pose in range(4)]
    assert chosen[0] == int(np.argmin(first))


def test_a_stack_of_one_way_leaves_no_doubt() -> None:
    told = some(np.random.default_rng(2), 1, 4)
    assert chance_wrong(np.ones(1), told) == 0.0 and float(overlap(np.ones(1), told)) == 0.0

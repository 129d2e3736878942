"""The next poses on problems small enough to try all choices; criteria against dense algebra."""

from itertools import combinations

import numpy as np
import pytest

from armd.compensation.design import design as module
from armd.compensation.design.criterion import ASKED, CauseSeparation, WeakestParameter
from armd.compensation.estimate.linear.linear_model import Layout, LinearModel


def known_of(gram: np.ndarray, asked: int) -> LinearModel:
    layout = Layout((("identified", len(gram) - asked), (ASKED, asked)))
    return LinearModel.from_products(layout, gram, np.full(len(gram), np.inf))


def information(seed: int, k: int) -> np.ndarray:
    rows = np.random.default_rng(seed).normal(size=(2 * k, k))
    return rows.T @ rows


def test_causes_stand_apart_as_in_one_dense_fit_with_one_reading_more() -> None:
    """Noise units: what of one cause's signal no amplitude of the rival and the others makes."""
    rng = np.random.default_rng(1)
    sessions, reading = rng.normal(size=(40, 6)), rng.normal(size=(3, 3, 6))
    signal = np.array([2.0, 0.0, 0.0])
    criterion = CauseSeparation("", signal[:, None], (slice(1, 3),), np.ones((1, 1)))
    known = known_of(sessions.T @ sessions, 3)
    for rows, found in (
        (sessions, criterion.separations(known)[0]),
        (np.vstack([sessions, reading[1]]), criterion.separations(known, reading)[1]),
    ):
        others, own = rows[:, [0, 1, 2, 4, 5]], rows[:, 3:] @ signal
        left = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
        assert found[0, 0] == pytest.approx(np.linalg.norm(left))


def test_a_parameter_is_as_uncertain_as_the_inverse_says_with_one_reading_more() -> None:
    gram, direction = information(2, 5), np.array([1.0, 0.0, -2.0, 0.0, 0.0])
    criterion = WeakestParameter("", "", direction)
    rows = np.random.default_rng(3).normal(size=(4, 3, 5))
    known = known_of(gram, 0)
    expected = [
        1 / np.sqrt(direction @ np.linalg.inv(gram + r.T @ r) @ direction)
        for r in (np.zeros((3, 5)), *rows)
    ]
    assert criterion.merit(known)[0] == pytest.approx(expected[0])
    np.testing.assert_allclose(criterion.merit(known, rows), expected[1:])
    assert criterion.merit(known.add_rows(rows[2]))[0] == pytest.approx(expected[3])


@pytest.mark.parametrize("seed", range(5))
def test_exchanges_come_near_the_best_of_all_choices(seed: int) -> None:
    rows = np.random.default_rng([4, seed]).normal(size=(14, 3, 5))
    known = known_of(1e-2 * information(seed, 5), 0)
    criterion = WeakestParameter("", "", np.eye(5)[seed])

    def merit(chosen) -> float:
        return module._merit(known.add_rows(rows[list(chosen)]), criterion)

    greedy = module._greedy(known, rows, criterion, 4)
    chosen = module._exchanged(known, rows, criterion, greedy)
    best = max(map(merit, combinations(range(14), 4)))
    assert len(set(chosen)) == 4
    assert merit(greedy) <= merit(chosen) + 1e-9
    assert merit(chosen) >= 0.95 * best

"""Certified lengths beside what the arm makes of them, of seats and residuals made up by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.identify.evaluation.lengths import Length, measure_certified_lengths

CERTIFIED = np.array([[0.0, 0.0, 0.0], [300.0, 0.0, 0.0], [0.0, 400.0, 0.0], [9.0, 9.0, 9.0]])
FOUND = np.array([[0.0, 0.0, 0.0], [300.003, 0.0, 0.0], [0.0, 400.0, 0.0], [0.0, 0.0, 0.0]])


def observations(target: list[int], placement: list[int], *, known: tuple[int, ...] = ()) -> Any:
    """Readings at seats A, B, C (D is touched by none), with lengths AB, BC and AD certified."""
    unknown = np.array([k not in known for k in range(4)])
    between = np.array([[0, 1], [1, 2], [0, 3]])
    return SimpleNamespace(
        n=len(target),
        target=np.array(target),
        placement=np.array(placement),
        placement_names=["P", "Q"],
        target_names=["A", "B", "C", "D"],
        unknown=unknown,
        has_truth=np.zeros(len(target), dtype=bool),
        freedom=np.full(len(target), 3),
        distances=SimpleNamespace(
            between=between,
            length_mm=np.linalg.norm(CERTIFIED[between[:, 0]] - CERTIFIED[between[:, 1]], axis=1),
            standard_uncertainty_mm=np.array([1e-3, 2e-3, 1e-3]),
        ),
    )


def scatter(n: int, size_mm: float) -> np.ndarray:
    """Residuals (n, 3) whose squares are the same at each reading and axis."""
    return size_mm * np.random.default_rng(1).choice([-1.0, 1.0], (n, 3))


def lengths_of(of: Any, residual: np.ndarray, **more: Any) -> list[Length]:
    return measure_certified_lengths(of, SimpleNamespace(target_mm=FOUND), residual, **more)  # type: ignore[arg-type]


def test_only_lengths_between_seats_that_were_touched_are_told() -> None:
    of = observations([0, 1, 2] * 4, [0] * 12)
    ab, bc = lengths_of(of, scatter(12, 0.002))
    assert (ab.between, bc.between) == (("A", "B"), ("B", "C"))
    assert ab.certified_mm == 300.0 and ab.measured_mm == pytest.approx(300.003)
    assert ab.error_mm == pytest.approx(0.003)
    assert bc.certified_mm == 500.0 and bc.error_mm == pytest.approx(0.0018, abs=1e-6)


SIZE_MM = 0.002
ENDS = [0] * 4 + [1] * 4
#: Targets and placements of the readings, certified targets, readings that each counts for; and the
#: variance of the distance AB in units of `SIZE_MM` squared: n readings of one seat in a placement
#: leave n − 1 of their scatter, Σ r² / 3 (n − 1), and their mean has 1 / n of it.
VARIANCES: dict[str, tuple[list[int], list[int], tuple[int, ...], float, float]] = {
    "means at both ends": ([0] * 4 + [1] * 9, [0] * 13, (), 1.0, 1 / 3 + 1 / 8),
    "each of two placements": ([0, 1] * 8, [0] * 8 + [1] * 8, (), 1.0, 8 / 6 * 2 / 4 / 2),
    "no placement has both ends": ([0] * 5 + [1] * 5, [0] * 5 + [1] * 5, (), 1.0, 2 / 4),
    "one end certified": (ENDS, [0] * 8, (0,), 1.0, 1 / 3),
    "both ends certified": (ENDS, [0] * 8, (0, 1), 1.0, 0.0),
    "five readings in each": ([0, 1] * 2, [0] * 4, (), 5.0, 2 / 9),
}


@pytest.mark.parametrize("case", VARIANCES)
def test_a_distance_is_as_uncertain_as_the_means_at_its_ends(case: str) -> None:
    target, placement, known, count, variance = VARIANCES[case]
    of, weight = observations(target, placement, known=known), np.full(len(target), count)
    (ab,) = lengths_of(of, scatter(len(target), SIZE_MM), weight=weight)
    assert ab.measured_uncertainty_mm == pytest.approx(SIZE_MM * np.sqrt(variance))
    assert ab.off == pytest.approx(0.003 / np.hypot(1e-3, ab.measured_uncertainty_mm))

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


def test_a_distance_is_as_uncertain_as_the_means_at_both_ends() -> None:
    """n readings of one seat in a placement leave n − 1 of their scatter: σ² = Σ r² / 3 (n − 1)."""
    of = observations([0] * 4 + [1] * 9, [0] * 13)
    (ab,) = lengths_of(of, scatter(13, 0.002))
    ends = [0.002**2 * n / (n - 1) / n for n in (4, 9)]
    assert ab.measured_uncertainty_mm == pytest.approx(np.sqrt(sum(ends)))
    assert ab.off == pytest.approx(0.003 / np.hypot(1e-3, ab.measured_uncertainty_mm))


def test_each_placement_tells_it_for_itself() -> None:
    """Two placements of four readings at each end: half the variance of one of them."""
    target, placement = [0, 1] * 8, [0] * 8 + [1] * 8
    (ab,) = lengths_of(observations(target, placement), scatter(16, 0.002))
    of_seat = 0.002**2 * 8 / (8 - 2)  # a mean in each placement
    assert ab.measured_uncertainty_mm == pytest.approx(np.sqrt(2.0 * of_seat / 4 / 2))


def test_ends_that_no_placement_holds_both_of_are_taken_each_alone() -> None:
    (ab,) = lengths_of(observations([0] * 5 + [1] * 5, [0] * 5 + [1] * 5), scatter(10, 0.002))
    assert ab.measured_uncertainty_mm == pytest.approx(np.sqrt(2.0 * 0.002**2 / 4))


def test_a_certified_end_adds_nothing_and_weights_count_readings() -> None:
    of = observations([0] * 4 + [1] * 4, [0] * 8, known=(0,))
    (ab,) = lengths_of(of, scatter(8, 0.002))
    assert ab.measured_uncertainty_mm == pytest.approx(np.sqrt(0.002**2 * 4 / 3 / 4))
    both = observations([0] * 4 + [1] * 4, [0] * 8, known=(0, 1))
    (ab,) = lengths_of(both, scatter(8, 0.002))
    assert ab.measured_uncertainty_mm == 0.0
    few = lengths_of(observations([0, 1] * 2, [0] * 4), scatter(4, 0.002), weight=np.full(4, 5.0))
    assert few[0].measured_uncertainty_mm == pytest.approx(np.sqrt(2.0 * 0.002**2 * 10 / 9 / 10))

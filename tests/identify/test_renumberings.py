"""Which targets an artefact's own are, counted from another end: against all permutations tried."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armd.arrays import F64
from armd.compensation.identify.admission.renumberings import find_renumberings


def found(points: F64) -> set[tuple[int, ...]]:
    return {tuple(map(int, onto)) for onto in find_renumberings(points)}


def tried(points: F64, near_mm: float) -> set[tuple[int, ...]]:
    """Every order of the points that some rotation brings within *near_mm* of theirs, and that
    renames more than two."""
    middle, orders = points - points.mean(axis=0), set()
    for order in permutations(range(len(points))):
        _, rssd = Rotation.align_vectors(middle[list(order)], middle)
        moved = sum(a != b for a, b in enumerate(order))
        if rssd / np.sqrt(len(points)) < near_mm and moved > 2:
            orders.add(order)
    return orders


def grid(columns: int, rows: int) -> F64:
    x, y = np.meshgrid(np.arange(columns) * 60.0, np.arange(rows) * 60.0)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


SHAPES = {
    "beam": np.column_stack([np.arange(6) * 95.0, np.zeros((6, 2))]),
    "plate of two by three": grid(3, 2),
    "square of four": grid(2, 2),
    "three on a wheel": np.array([[np.cos(a), np.sin(a), 0.0] for a in (0.0, 2.1, 4.2)]) * 80.0,
    "cube": np.array([[x, y, z] for x in (0, 90) for y in (0, 90) for z in (0, 60)], float)[:7],
}


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(3))
def test_they_are_those_of_all_permutations_that_a_rotation_brings_near(
    shape: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    points = SHAPES[shape] + rng.normal(0.0, 1.0, SHAPES[shape].shape)  # of 60 mm spacing
    turned = points @ Rotation.random(rng=rng).as_matrix().T + rng.normal(0.0, 300.0, 3)
    assert found(turned) == tried(points, 10.0)


def test_a_beam_has_one_and_a_square_plate_seven() -> None:
    beam = np.column_stack([np.arange(9) * 70.0, np.zeros((9, 2))])
    assert found(beam) == {tuple(range(8, -1, -1))}
    assert len(found(grid(5, 5))) == 7  # of the eight of a square, without the one that is none
    assert len(found(grid(5, 4))) == 3


def test_what_looks_otherwise_from_each_end_has_none() -> None:
    rng = np.random.default_rng(3)
    assert not found(rng.uniform(-200.0, 200.0, (12, 3)))
    assert not found(np.array([[0.0, 0, 0], [40.0, 0, 0], [100.0, 0, 0], [300.0, 0, 0]]))
    assert not found(grid(2, 1)) and not found(np.empty((0, 3)))  # two are an exchange
    twice = np.array([[0.0, 0, 0], [0.0, 0, 0], [100.0, 0, 0]])
    assert not found(twice)

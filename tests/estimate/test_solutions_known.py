"""One linear least-squares problem, known and leaning on the drawing: dense algebra, simulation."""

import numpy as np
import pytest

from armd.compensation.estimate.linear.linear_model import Layout, LinearModel
from armd.compensation.estimate.linear.solution import LEAST_KNOWN, Solution

SCALE = np.array([10.0, 0.02, 3.0, 1.0])


def leaned(
    columns: np.ndarray,
    residual: np.ndarray,
    drawn: np.ndarray | None = None,
    damping: float = 0.0,
    held: bool = False,
) -> Solution:
    """What to change of the unknowns so that *residual* (n,) becomes least."""
    free, layout = np.full(4, np.inf), Layout((("unknowns", 4),))
    model = LinearModel.from_products(layout, columns.T @ columns, free, nominal_variance=SCALE**2)
    drawn = np.zeros(4) if drawn is None else drawn
    return model.solve_with_prior(-columns.T @ residual, drawn, damping, held)


def rows(strengths: list[float], seed: int = 1, n: int = 30) -> tuple[np.ndarray, np.ndarray]:
    """Columns (n, 4), of which the scaled singular values are *strengths*, and a residual (n,)."""
    rng = np.random.default_rng(seed)
    u = np.linalg.qr(rng.normal(size=(n, 4)))[0]
    v = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    return u @ np.diag(strengths) @ v.T / SCALE, 50.0 * rng.normal(size=n)


def test_where_all_is_known_it_is_least_squares() -> None:
    columns, residual = rows([900.0, 300.0, 70.0, 20.0])
    pull = np.array([1.0, 0.01, -1.0, 0.3])  # the drawing has no say
    found = leaned(columns, residual, pull)
    wanted, rest, *_ = np.linalg.lstsq(columns, -residual, rcond=None)
    np.testing.assert_allclose(found.step, wanted, rtol=1e-9)
    assert (
        found.rank == 4
        and found.effective_rank == pytest.approx(4.0)
        and found.null.shape == (4, 0)
    )
    assert found.gain == pytest.approx(float(residual @ residual - rest[0]))
    plain = np.linalg.inv(columns.T @ columns)
    np.testing.assert_allclose(found.compute_known_covariance(), plain, rtol=1e-9)
    np.testing.assert_allclose(found.covariance(np.zeros((4, 0))), plain, rtol=1e-9)
    np.testing.assert_allclose(found.root @ found.root.T, plain, rtol=1e-9)


def test_along_what_is_not_known_the_drawing_is_one_more_reading() -> None:
    columns, residual = rows([900.0, 300.0, 4.0, 0.0])
    pull = np.array([1.0, 0.01, -1.0, 0.3])
    found = leaned(columns, residual, pull)
    assert found.rank == 2 and found.is_known.tolist() == [True, True, False, False]
    # The same as rows for the drawing along these directions, of weight one each.
    leaning = found.null.T / SCALE
    wanted = np.linalg.lstsq(
        np.vstack([columns, leaning]), np.concatenate([-residual, leaning @ pull]), rcond=None
    )[0]
    np.testing.assert_allclose(found.step, wanted, rtol=1e-9)
    whole = np.linalg.inv(columns.T @ columns + leaning.T @ leaning)
    np.testing.assert_allclose(found.covariance(np.zeros((4, 0))), whole, rtol=1e-8)
    assert found.effective_rank == pytest.approx(2.0 + 16.0 / 17.0)
    assert found.compute_nominal_cost(np.zeros(4)) == 0.0
    assert found.compute_nominal_cost(pull) == pytest.approx(float(((leaning @ pull) ** 2).sum()))
    # Nothing beside what is known is in the known step; a gauge is not uncertain.
    np.testing.assert_allclose(leaning @ found.known_step, 0.0, atol=1e-12)
    gauge = found.directions[:, 3:]
    certain = found.covariance(gauge)
    np.testing.assert_allclose(gauge.T @ (certain / np.outer(SCALE, SCALE)), 0.0, atol=1e-12)


def test_held_all_lean_and_damping_shortens() -> None:
    columns, residual = rows([900.0, 300.0, 70.0, 20.0])
    found = leaned(columns, residual, held=True)
    ridged = columns.T @ columns + np.diag(1.0 / SCALE**2)
    np.testing.assert_allclose(found.step, np.linalg.solve(ridged, -columns.T @ residual))
    lengths = [
        float(np.linalg.norm(leaned(columns, residual, damping=d).step / SCALE))
        for d in (0.0, 1e-4, 1e-2, 1.0)
    ]
    assert lengths == sorted(lengths, reverse=True) and lengths[-1] < lengths[0]


@pytest.mark.parametrize("n", [2, 4])
def test_fewer_rows_than_unknowns_are_solved_with_the_drawing(n: int) -> None:
    columns, residual = rows([900.0, 300.0, 70.0, 20.0], n=30)
    pull = np.array([1.0, 0.01, -1.0, 0.3])
    found = leaned(columns[:n], residual[:n], pull)
    if n < 4:
        np.testing.assert_allclose(
            found.null.T @ (found.step / SCALE), found.null.T @ (pull / SCALE)
        )
    assert found.rank <= n
    assert (found.singular_values[found.is_known] > LEAST_KNOWN).all()


def test_rounding_of_readings_without_noise_is_not_taken_for_knowledge() -> None:
    """A gauge that products cannot show as zero: the directions known to ten digits stay apart."""
    columns, residual = rows([1e8, 3e7, 2e6, 0.0])
    found = leaned(columns, residual)
    assert found.is_known.tolist() == [True, True, True, False]

"""`LinearModel` against dense algebra: stacked rows, each prior one row more."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armd.compensation.estimate.linear import linear_model
from armd.compensation.estimate.linear.bordered import compute_pseudo_inverse_factor
from armd.compensation.estimate.linear.linear_model import Layout, LinearModel

N = 60


def blocks(seed: int, gauge: bool = False):
    """Three blocks of columns of very unlike lengths, one with priors; *gauge*: two columns are the
    same but for their length."""
    rng = np.random.default_rng(seed)
    free = rng.normal(size=(N, 4)) * [1.0, 1e3, 1e-3, 5.0]
    held = rng.normal(size=(N, 3)) * [10.0, 1.0, 1e-2]
    more = rng.normal(size=(N, 2))
    if gauge:
        more[:, 1] = 7.0 * free[:, 0]
    return [
        ("placements", free, np.full(4, np.inf)),
        ("targets", held, np.array([1e-3, 0.5, 1e2])),
        ("finding", more, np.full(2, np.inf)),
    ]


def stacked(of) -> tuple[np.ndarray, np.ndarray]:
    """All columns with one row more per prior, and their lengths; (N + b, b)."""
    columns = np.hstack([c for _, c, _ in of])
    root = 1.0 / np.sqrt(np.concatenate([v for *_, v in of]))
    rows = np.vstack([columns, np.diag(root)])
    length = np.linalg.norm(rows, axis=0)
    return rows / length, length


def clear_of(rows: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Other columns (N, k), extended by zeros, clear of the range of *rows* by its SVD."""
    u, s, _ = np.linalg.svd(rows, full_matrices=False)
    u = u[:, s > 1e-9 * s[0]]
    extended = np.vstack([others, np.zeros((len(rows) - N, others.shape[1]))])
    return extended - u @ (u.T @ extended)


@pytest.mark.parametrize("gauge", [False, True])
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_what_is_left_of_other_columns_is_what_an_orthogonal_projection_leaves(gauge, seed) -> None:
    of = blocks(seed, gauge)
    others = np.random.default_rng([seed, 1]).normal(size=(N, 5))
    model = LinearModel.from_rows(of)
    columns = np.hstack([c for _, c, _ in of])
    taken = model.project(columns.T @ others)
    clear = clear_of(stacked(of)[0], others)
    np.testing.assert_allclose(others.T @ others - taken.T @ taken, clear.T @ clear, atol=1e-7)
    left = others - columns @ model.explain(columns.T @ others)
    np.testing.assert_allclose(left, clear[:N], atol=1e-6)


@pytest.mark.parametrize("gauge", [False, True])
def test_taken_apart_a_projection_takes_the_same(
    monkeypatch: pytest.MonkeyPatch, gauge: bool
) -> None:
    """Of many columns; also where nothing tells two of them apart."""
    of = blocks(7)
    if gauge:
        of.append(("again", of[0][1], np.full(of[0][1].shape[1], np.inf)))
    model, columns = LinearModel.from_rows(of), np.hstack([c for _, c, _ in of])
    others = np.random.default_rng(8).normal(size=(N, 3))
    at_once = model.project(columns.T @ others)
    monkeypatch.setattr(linear_model, "MANY", 0)
    apart = model.project(columns.T @ others)
    np.testing.assert_allclose(apart.T @ apart, at_once.T @ at_once, atol=1e-7)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_solution_is_that_of_stacked_least_squares(seed) -> None:
    of = blocks(seed)
    residual = np.random.default_rng([seed, 2]).normal(size=N)
    rows, length = stacked(of)
    side = np.hstack([c for _, c, _ in of]).T @ residual
    solution, covariance = LinearModel.from_rows(of).solve(side)
    expected = np.linalg.lstsq(rows, np.append(residual, np.zeros(len(side))), rcond=None)[0]
    np.testing.assert_allclose(solution, expected / length, rtol=1e-6, atol=1e-9)
    dense = np.linalg.inv(rows.T @ rows) / np.outer(length, length)
    np.testing.assert_allclose(covariance, dense, rtol=1e-6, atol=1e-9)


def test_what_nothing_is_known_of_stays_zero_and_with_a_drawing_near_it() -> None:
    """x₁ + x₂ = 4 is all that is measured: shared alike, or by how well each is drawn."""
    rows = np.array([[1.0, 1.0]])
    layout = Layout((("x", 2),))
    open_ = LinearModel.from_products(layout, rows.T @ rows, np.full(2, np.inf))
    np.testing.assert_allclose(open_.solve(rows[0] * 4.0)[0], [2.0, 2.0])
    drawn = np.array([1e6, 3e6])
    held = LinearModel.from_products(
        layout, rows.T @ rows, np.full(2, np.inf), nominal_variance=drawn
    )
    solution, covariance = held.solve(rows[0] * 4.0)
    np.testing.assert_allclose(solution, [1.0, 3.0], rtol=1e-4)
    assert covariance[0, 0] == pytest.approx(0.75e6, rel=1e-4)  # 1/(1/1e6 + 1/3e6), as they share
    # A drawing chooses where rows are silent; projection minds the rows and priors alone.
    np.testing.assert_allclose(held.project(np.ones(2)), open_.project(np.ones(2)))


def test_a_prior_far_tighter_than_the_rows_of_one_hides_nothing_of_the_others() -> None:
    matrix = np.diag([1e14, 1.0])
    factor = compute_pseudo_inverse_factor(matrix)
    np.testing.assert_allclose(factor @ factor.T, np.diag([1e-14, 1.0]))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_information_of_a_block_is_the_inverse_of_its_covariance(seed) -> None:
    model = LinearModel.from_rows(blocks(seed))
    _, covariance = model.solve(np.zeros(model.layout.n))
    for names in (("targets",), ("finding", "placements")):
        own = model.layout.find_columns(names)
        scale = np.sqrt(np.diag(covariance)[own])
        expected = np.linalg.inv(covariance[np.ix_(own, own)] / np.outer(scale, scale))
        found = model.compute_information(*names) * np.outer(scale, scale)
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)


def test_without_a_block_it_is_the_problem_that_never_had_it() -> None:
    of = blocks(5)
    side = np.hstack([c for _, c, _ in of]).T @ np.ones(N)
    less = LinearModel.from_rows(of).without("targets")
    anew = LinearModel.from_rows([of[0], of[2]])
    assert [name for name, size in less.layout.sizes if size] == ["placements", "finding"]
    kept = LinearModel.from_rows(of).layout.find_other_columns(["targets"])
    np.testing.assert_allclose(less.solve(side[kept])[0], anew.solve(side[kept])[0], rtol=1e-9)


def test_problems_of_different_rows_add_and_a_block_joins_what_is_there() -> None:
    of = blocks(9)
    halves = [
        LinearModel.from_rows([(name, columns[rows], variance) for name, columns, variance in of])
        for rows in (slice(0, 20), slice(20, N))
    ]
    whole = LinearModel.from_rows(of)
    for found in (
        halves[0] + halves[1],
        LinearModel.from_rows(of[:2]).add_block(
            "finding",
            of[2][1].T @ of[2][1],
            np.hstack([of[0][1], of[1][1]]).T @ of[2][1],
            of[2][2],
        ),
    ):
        assert found.layout == whole.layout
        np.testing.assert_allclose(found.gram, whole.gram)
        np.testing.assert_allclose(found.squared_norm, whole.squared_norm)
        np.testing.assert_allclose(found.variance, whole.variance)

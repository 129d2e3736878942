"""Huber's loss by reweighting against a general minimiser; scatter of the rests that speak."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import chi2

from armd.compensation.diagnose.scoring import robust_refit, scatter
from armd.compensation.diagnose.scoring.projection import Projection
from armd.compensation.effects.sizes import compute_broadest_sd
from armd.compensation.estimate.linear.linear_model import Layout, LinearModel
from armd.compensation.estimate.noise.robust import WINSOR_AT
from support.small_fit import candidate, small_fit

N = 60
CAUSE = candidate("encoder_scale", 1)


def projection_of(residual: np.ndarray, raw: np.ndarray, columns: np.ndarray) -> Projection:
    """Rows of one fit whose shared columns are *columns* (3 n, b), nothing eliminated before."""
    fit = small_fit(residual, columns, raw=raw)
    layout = Layout((("shared", columns.shape[1]),))
    model = LinearModel.from_products(layout, columns.T @ columns, np.full(columns.shape[1], 50.0))
    nothing: Any = None
    return Projection(
        fit=fit,
        arm=nothing,
        shapes=SimpleNamespace(),  # type: ignore[arg-type]
        cells=(),
        jacobian=nothing,
        shared_number=np.arange(columns.shape[1]),
        parts=(model,),
        cleared=np.column_stack([columns, residual]),
        side=(columns.T @ residual)[None],
    )


def huber(left: np.ndarray) -> float:
    size = np.linalg.norm(left.reshape(-1, 3), axis=1)
    within = np.minimum(size, WINSOR_AT)
    return float((within * (size - 0.5 * within)).sum())


@pytest.fixture
def made(monkeypatch):
    """A cause that six of sixty rests show, strongly: clipped, it looks like a tail."""
    rng = np.random.default_rng(1)
    shared, own = rng.normal(size=(3 * N, 3)), np.zeros(3 * N)
    own[:18] = rng.normal(size=18)
    raw = shared @ [1.0, -2.0, 0.5] + 12.0 * own + rng.normal(size=3 * N)
    size = np.repeat(np.linalg.norm(raw.reshape(-1, 3), axis=1), 3)
    clipped = raw * np.minimum(1.0, WINSOR_AT / size)
    for module in (robust_refit, scatter):
        monkeypatch.setattr(module, "make_finding_columns", lambda *_: [own[:, None]])
    return projection_of(clipped, raw, shared), shared, own, raw


def test_the_robust_solution_is_that_of_a_general_minimiser(made) -> None:
    projection, shared, own, raw = made
    found = robust_refit._absorbing(projection).joined(CAUSE).robust()
    columns = np.column_stack([shared, own])
    ridge = np.array([1 / 50.0] * 3 + [compute_broadest_sd(CAUSE.columns[0]) ** -2])

    def cost(x: np.ndarray) -> float:
        return huber(raw - columns @ x) + 0.5 * float(x**2 @ ridge)

    best = minimize(cost, np.linalg.lstsq(columns, raw)[0], method="BFGS", options={"gtol": 1e-8})
    assert found.loss == pytest.approx(best.fun, abs=0.02)
    left = (raw - columns @ best.x).reshape(-1, 3)
    np.testing.assert_allclose(found.residual, left, atol=0.05)
    size = np.linalg.norm(found.residual, axis=1)
    np.testing.assert_allclose(found.weight_deficit, 1.0 - WINSOR_AT / np.maximum(size, WINSOR_AT))


def test_least_squares_with_a_prior_is_half_the_least_sum(made) -> None:
    projection, shared, _, _ = made
    nothing = robust_refit._absorbing(projection)
    rows = np.vstack([shared, np.eye(3) / np.sqrt(50.0)])
    side = np.append(projection.fit.residual, np.zeros(3))
    least = np.linalg.lstsq(rows, side, rcond=None)[1][0]
    assert nothing.compute_clipped_loss() == pytest.approx(0.5 * least)


def test_what_was_clipped_stands_where_it_was_measured_beside_its_own_cause(made) -> None:
    projection, _, own, raw = made
    about = robust_refit.clip_about(CAUSE, projection).fit.residual
    shown = np.flatnonzero(own)
    kept = np.linalg.norm(projection.fit.residual[shown] - raw[shown])
    assert np.linalg.norm(about[shown] - raw[shown]) < 0.2 * kept
    gain = robust_refit.compute_unclipped_gain([CAUSE, CAUSE], np.zeros(2), projection)
    assert (gain > 10.0).all()


def test_many_rests_of_even_noise_score_as_the_noise_says(monkeypatch) -> None:
    rng = np.random.default_rng(2)
    n = 3000
    own, residual = rng.normal(size=3 * n), rng.normal(size=3 * n)
    residual += 0.05 * own
    monkeypatch.setattr(scatter, "make_finding_columns", lambda *_: [own[:, None]])
    projection = projection_of(residual, residual, rng.normal(size=(3 * n, 2)))
    log_p = scatter.compute_log_p_by_scatter(CAUSE, projection)
    score = float(own @ residual) ** 2 / float(own @ own)
    assert log_p == pytest.approx(chi2.logsf(score, 1), rel=0.1)


def test_a_handful_that_err_alike_by_chance_of_their_tails_prove_little(monkeypatch) -> None:
    """Four rests of one target, all of them far off: the noise's p is tiny, theirs is not."""
    own = np.zeros(3 * N)
    own[:12:3] = 1.0
    residual = np.random.default_rng(3).normal(size=3 * N)
    residual[:12:3] = [9.0, 1.0, 8.0, -2.0]
    monkeypatch.setattr(scatter, "make_finding_columns", lambda *_: [own[:, None]])
    rest = np.zeros((3 * N, 1))
    rest[-1] = 1.0
    log_p = scatter.compute_log_p_by_scatter(CAUSE, projection_of(residual, residual, rest))
    assert chi2.logsf(16.0**2 / 4, 1) < -30.0
    assert log_p > np.log(0.01)

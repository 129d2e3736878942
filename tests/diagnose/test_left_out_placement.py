"""A fit without the readings of a placement is the pseudo-inverse's, of which it needs none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.diagnose.fitting.fit import columns_told_of
from armd.compensation.diagnose.fitting.refit import Refits
from armd.compensation.diagnose.problem.fitted import Fit
from support.small_fit import small_fit

RESTS = 12


def fit() -> Fit:
    """Of two placements with six columns each, and three constants."""
    rng = np.random.default_rng(1)
    placements = np.zeros((3 * RESTS, 12))
    placements[: 3 * RESTS // 2, :6] = rng.normal(size=(3 * RESTS // 2, 6))
    placements[3 * RESTS // 2 :, 6:] = rng.normal(size=(3 * RESTS // 2, 6))
    return small_fit(
        rng.normal(size=3 * RESTS), placements, identified=rng.normal(size=(3 * RESTS, 3))
    )


def test_the_pose_left_out_stays_and_all_else_is_the_least_norm_solution(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known = fit()
    whitener = known.noise.whitener.copy()
    whitener[RESTS // 2 :] = 0.0
    rows, half = known.nuisance.columns.dense(), 3 * RESTS // 2
    prior = np.diag(1.0 / known.nuisance.variance)
    expected = np.linalg.pinv(rows[:half].T @ rows[:half] + prior) @ (
        rows[:half].T @ known.residual[:half]
    )
    monkeypatch.setattr(np.linalg, "eigh", None)  # what takes long, and is not needed
    found = Refits(known, replace(known.noise, whitener=whitener)).with_some([])
    np.testing.assert_allclose(found.solution, expected, atol=1e-10)
    assert not found.solution[6:12].any() and found.solution[:6].all()
    assert columns_told_of(found.problem).tolist() == [*range(6), 12, 13, 14]

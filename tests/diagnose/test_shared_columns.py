"""Errors that rests share, against displacements written down by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from armd.compensation.diagnose.noise.shared_columns import make_drift_columns, make_target_nuisance

N, PLACEMENTS = 48, 4


def problem(**observed: Any) -> Any:
    """Rests of two targets in two placements of each of two sessions; two certified lengths."""
    observations = {
        "placement": np.arange(N) * PLACEMENTS // N,
        "session": (np.arange(N) >= N // 2).astype(int),
        "target": np.arange(N) % 2,
        "turned": np.zeros(N, dtype=bool),
        "has_truth": np.zeros(N, dtype=bool),
        "uncertainty_mm": np.array([0.002, 0.0]),
        "unknown": np.zeros(2, dtype=bool),
        "states": SimpleNamespace(time_s=3600.0 * np.arange(N) / N),
    }
    turns = Rotation.random(PLACEMENTS, random_state=5).as_matrix()
    return SimpleNamespace(
        rests=SimpleNamespace(
            n=N,
            observations=SimpleNamespace(**observations | observed),
            target_label=["A", "B"],
        ),
        normal=None,
        poses=SimpleNamespace(rotation=turns),
        residual=np.zeros(3 * N + 2),
    )


def test_a_certified_target_elsewhere_shifts_its_rests_as_its_placements_are_turned() -> None:
    linear, moved_mm = problem(), np.array([0.001, -0.002, 0.003])
    columns, variance = make_target_nuisance(linear)
    np.testing.assert_allclose(variance, 0.002**2)  # of A; of B nothing is uncertain
    placement = linear.rests.observations.placement
    expected = np.zeros((N, 3))
    expected[::2] = (linear.poses.rotation[placement] @ moved_mm)[::2]
    np.testing.assert_allclose((columns @ moved_mm)[: 3 * N], expected.ravel(), atol=1e-15)
    assert not (columns @ moved_mm)[3 * N :].any()


def test_a_base_that_wanders_between_knots_is_a_sum_of_drift_columns() -> None:
    linear = problem()
    columns, variance = make_drift_columns(linear)
    dense = columns.to_dense()
    assert np.isnan(variance).all() and not dense[3 * N :].any()
    observations, rng = linear.rests.observations, np.random.default_rng(7)
    knots_of_a_session = dense.shape[1] // 6  # two sessions, three directions
    wandered_mm = np.zeros((N, 3))
    for session in (0, 1):
        rows = observations.session == session
        time_s = observations.states.time_s[rows]
        knots_s = np.linspace(time_s.min(), time_s.max(), knots_of_a_session)
        for axis in range(3):
            heights = rng.normal(size=knots_of_a_session)
            wandered_mm[rows, axis] = np.interp(time_s, knots_s, heights)
    fitted = np.linalg.lstsq(dense[: 3 * N], wandered_mm.ravel(), rcond=None)[0]
    np.testing.assert_allclose(dense[: 3 * N] @ fitted, wandered_mm.ravel(), atol=1e-10)


def test_readings_of_one_instant_show_no_drift() -> None:
    columns, variance = make_drift_columns(
        problem(states=SimpleNamespace(time_s=np.full(N, np.nan)))
    )
    assert not columns.to_dense().size and not variance.size

"""What columns of its own bring a group of rows: held against least squares done whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.estimate.observations import collect_observations
from armd.compensation.identify.admission.row_groups import clear_rows, order_by_acquisition
from armd.compensation.identify.fit import Identification
from armd.compensation.model.parameters import TIP_PARAMETERS
from support import synthetic
from support.fitted import fit_constants

ARM = synthetic.arm()
N = 60
NOBODY = np.zeros(0, dtype=np.int64)


@pytest.fixture(scope="module")
def found() -> Identification:
    """Two sessions, the first of which started last; 20 µm of noise."""
    truth = synthetic.disturbed(ARM, np.random.default_rng(1), 0.3)
    sessions = []
    for k, name in enumerate(("late", "early")):
        seen = synthetic.tracked(ARM, truth, np.random.default_rng(2 + k), readings=N)
        noise_mm = np.random.default_rng(8 + k).normal(0.0, 0.02, (N, 3))
        states = replace(seen.states, time_s=seen.states.time_s - 1e5 * k)
        sessions.append(
            replace(
                seen, name=name, path=Path(name), states=states, truth_mm=seen.truth_mm + noise_mm
            )
        )
    return fit_constants(collect_observations(sessions, ARM))


def test_sessions_stand_by_their_start(found: Identification) -> None:
    assert order_by_acquisition(found).tolist() == [*range(N, 2 * N), *range(N)]


def test_a_group_gains_what_least_squares_with_its_columns_does(found: Identification) -> None:
    cleared = clear_rows(found, NOBODY)
    assert cleared is not None
    tip = found.linearisation.make_constant_columns(TIP_PARAMETERS)
    group = np.arange(2 * N) < 25
    gain = cleared.gain(tip, group)

    weight = np.empty(2 * N)
    weight[cleared.order] = cleared.weight
    poses = np.zeros((2 * N, 3, 12))
    poses[:N, :, :6], poses[N:, :, 6:] = (
        found.linearisation.pose_columns[:N],
        found.linearisation.pose_columns[N:],
    )
    constants = found.unknowns.columns(
        found.linearisation.jacobian, found.linearisation.basis, found.terms
    )
    fitted = np.concatenate([constants, poses], axis=2)
    both = np.concatenate([tip * group[:, None, None], fitted], axis=2)
    residual = (weight[:, None] * found.linearisation.residual_mm).ravel()
    left = []
    for columns in (fitted, both):
        whole = (weight[:, None, None] * columns).reshape(6 * N, -1)
        step = np.linalg.lstsq(whole, -residual, rcond=1e-9)[0]
        left.append(float(((residual + whole @ step) ** 2).sum()))
    assert cleared.squared_sum == pytest.approx(left[0], rel=1e-6)
    assert gain.residual_share == pytest.approx(left[1] / left[0], rel=1e-6)
    np.testing.assert_allclose(gain.step, step[:3], atol=1e-6)
    assert gain.n_unabsorbed == 3


def test_the_best_stretch_is_the_best_of_all(found: Identification) -> None:
    """A step of 40 µm in some rows is found by its own columns, at these rows."""
    tip = found.linearisation.make_constant_columns(TIP_PARAMETERS)
    group = np.zeros(2 * N, dtype=bool)
    group[N + 13 : N + 46] = True
    moved = (tip @ np.array([0.2, -0.1, 0.15])) * group[:, None]
    at = replace(found.linearisation, residual_mm=found.linearisation.residual_mm + moved)
    cleared = clear_rows(replace(found, linearisation=at), NOBODY)
    assert cleared is not None
    best = cleared.best_stretch(tip)
    assert best is not None and (best.group != group).sum() <= 2
    assert best.residual_share <= cleared.gain(tip, group).residual_share + 1e-12


def test_what_is_fitted_anyway_gains_nothing(found: Identification) -> None:
    cleared = clear_rows(found, NOBODY)
    assert cleared is not None
    tip = found.linearisation.make_constant_columns(TIP_PARAMETERS)
    gain = cleared.gain(tip, np.ones(2 * N, dtype=bool))
    assert gain.n_unabsorbed == 0 and gain.residual_share == pytest.approx(1.0)

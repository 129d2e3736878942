"""The low-rank factor against the covariance it stands for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_model import POSE_FACTORS

from armd import POINT
from armd.compensation.kernel.covariance import NEGLECTED, factorise_pivoted
from armd.compensation.kernel.model import Model
from armd.compensation.model import parameters
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.parameters import ParameterLayout
from support.drawn_calibration import WARM, an_arm, calibrated, term

N_JOINTS = 3
NAMES = ParameterLayout(N_JOINTS).names


def factor_of(covariance: np.ndarray) -> np.ndarray:
    n = len(covariance)
    columns = np.empty((n, n))
    rank = factorise_pivoted(covariance, np.empty(n), columns)
    return columns[:rank].T


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 40), decades=st.floats(0, 12))
def test_hardly_more_columns_than_eigenvectors_would_need(
    seed: int, n: int, decades: float
) -> None:
    rng = np.random.default_rng(seed)
    directions = np.linalg.qr(rng.normal(size=(n, n)))[0]
    variances = 10.0 ** -rng.uniform(0, decades, n)
    covariance = directions * variances @ directions.T
    factor = factor_of(covariance)
    rest = covariance - factor @ factor.T
    assert np.trace(rest) <= NEGLECTED * np.trace(covariance)
    assert np.linalg.eigvalsh(rest).min() > -1e-12 * variances.max()
    enough = np.cumsum(np.sort(variances)) > NEGLECTED * variances.sum()
    assert factor.shape[1] <= enough.sum() + 1 + n // 8


def test_nothing_and_unknown() -> None:
    assert factor_of(np.zeros((4, 4))).shape == (4, 0)
    assert np.isnan(factor_of(np.full((4, 4), np.nan))).all()


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), noise_c=st.sampled_from([0.0, 0.02]))
def test_everything_uncertain_is_in_it(seed: int, noise_c: float) -> None:
    rng = np.random.default_rng(seed)
    arm = an_arm(N_JOINTS)
    pose = [term("theta_2", POSE_FACTORS[0]), term("d_3", POSE_FACTORS[1], WARM, coefficient=2e-3)]
    terms = [term("a_1", WARM), *pose, term("a_1", {**WARM, "order": 2})]
    of = [*rng.choice(NAMES, 6, replace=False), "term 3", "term 0", "term 2"]
    root = rng.normal(size=(9, 9)) * 1e-4
    encoder_rad = [1e-6, 2e-6, 3e-6]
    noise = {"encoder_rad": encoder_rad, "temperature_c": noise_c, "reading_mm": 0.02}
    model = Model(
        arm,
        calibrated(arm, terms, noise=noise, covariance_of=of, covariance=(root @ root.T).tolist()),
    )
    celsius = rng.uniform(15, 30, 2)
    model.fold(celsius, 0.0)
    found, rows, floor = model.covariance
    assert floor == 0.02**2  # repeatability stands beside what the encoders' noise does
    factor = np.zeros((len(NAMES) + 2, found.shape[1]))
    factor[rows] = found

    warm = 0.4 * celsius[0] + 0.6 * celsius[1] - 20.0
    size = len(NAMES) + 2  # the pose terms follow the parameters, in their parameters' order
    acts = np.zeros((size, 9))
    for i, name in enumerate(of[:6]):
        acts[NAMES.index(name), i] = 1.0
    a_1, theta_2_term, d_3_term = NAMES.index("a_1"), len(NAMES), len(NAMES) + 1
    acts[a_1, 6], acts[a_1, 7], acts[d_3_term, 8] = warm**2, warm, warm
    covariance = acts @ root @ root.T @ acts.T
    for k, deviation in enumerate(encoder_rad):
        covariance[5 * k, 5 * k] += deviation**2
    for weight in (0.4, 0.6):
        moved = np.zeros(size)
        moved[a_1] = 1e-4 * (weight * noise_c + (warm + weight * noise_c) ** 2 - warm**2)
        moved[d_3_term] = 2e-3 * weight * noise_c
        covariance += np.outer(moved, moved)
    assert not covariance[theta_2_term].any()

    # Judged in mm at the tip: an angle moves it by the arm's reach.
    nominal = arm.nominal()
    reach_mm = np.hypot(nominal[1:15:5], nominal[2:15:5]).sum() + np.linalg.norm([10, 20, 150])
    units = [parameters.find_unit(name) for name in NAMES]
    mm = np.array([1.0 if unit == "mm" else reach_mm for unit in [*units, "rad", "mm"]])
    whole, kept = covariance * np.outer(mm, mm), (mm[:, None] * factor) @ (mm[:, None] * factor).T
    total = np.trace(whole)
    assert np.trace(whole - kept) <= NEGLECTED * total * 1.001
    assert kept == pytest.approx(whole, abs=NEGLECTED * total)
    # What is larger than all that may be neglected must be there, as the first bound wants it
    assert factor.shape[1] <= np.linalg.matrix_rank(whole, tol=NEGLECTED * total)


def test_what_only_the_prior_knows_takes_nothing_from_a_points_own_covariance() -> None:
    """Parameters that move no point together have variances of many mm²; a point's is of µm²."""
    arm = an_arm(N_JOINTS)
    # The constants of `calibrated`: what moves no point depends on them.
    constants = arm.nominal() + np.random.default_rng(8).normal(0, 1e-3, arm.layout.count)
    of = [name for name in NAMES if not name.startswith("artefact")]
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.0, 2.0, (60, N_JOINTS))

    def tip(row: np.ndarray, at: np.ndarray) -> np.ndarray:
        return compute_pose(at, row)[0]

    def jacobian(at: np.ndarray) -> np.ndarray:
        columns = []
        for name in of:
            step = 1e-4
            there, back = constants.copy(), constants.copy()
            there[NAMES.index(name)] += step
            back[NAMES.index(name)] -= step
            columns.append((tip(there, at) - tip(back, at)) / (2 * step))
        return np.stack(columns, axis=-1)  # (n, 3, K)

    measured = jacobian(q).reshape(-1, len(of)) / 0.005
    prior = [1 / 3.0 if parameters.find_unit(name) == "mm" else 1 / 0.02 for name in of]
    _, known, directions = np.linalg.svd(np.vstack([measured, np.diag(prior)]), full_matrices=False)
    covariance = directions.T / known**2 @ directions
    noise = {"encoder_rad": [0.0] * N_JOINTS, "temperature_c": 0.0, "reading_mm": 1e-4}
    model = Model(
        arm, calibrated(arm, [], noise=noise, covariance_of=of, covariance=covariance.tolist())
    )
    model.fold(np.full(2, 20.0), 0.0)
    elsewhere = rng.uniform(-2.0, 2.0, (50, N_JOINTS))
    points = np.zeros(50, POINT)
    model.correct(elsewhere, np.zeros((50, N_JOINTS)), np.zeros((50, 3)), points)
    derivatives = jacobian(elsewhere)
    expected = np.einsum("nia,ab,nib->ni", derivatives, covariance, derivatives) + 1e-8
    assert np.sqrt(covariance.diagonal().max()) > 100 * np.sqrt(expected.max())
    found = points["covariance_mm2"][:, [0, 3, 5]]
    assert np.sqrt(found) == pytest.approx(np.sqrt(expected), rel=0.01)

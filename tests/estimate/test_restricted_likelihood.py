"""The noise of readings by restricted likelihood, and what a fit leaves of each: dense algebra."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from armd.compensation.estimate.gauge import list_free_constants
from armd.compensation.estimate.linearise import Linearisation, linearise
from armd.compensation.estimate.noise.reading import ReadingNoise, estimate_noise, make_whitening
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.identify.arm_alone import ArmAlone
from armd.compensation.model.kinematics import compute_pose
from support import synthetic

ENCODER_RAD, READING_MM = 3e-5, 0.03  # about alike at the tip: the best ratio lies inside


def problem(seed: int, n: int = 40, unknowns: int = 36) -> tuple[Any, Any, Any]:
    """Levers (n, 3, 6) mm/rad of an arm, columns (3 n, C) of what is fitted, residuals (3 n,)."""
    rng = np.random.default_rng(seed)
    joints = rng.normal(size=(n, 3, 6)) * rng.uniform(50.0, 600.0, (n, 1, 1))
    columns = rng.normal(size=(3 * n, unknowns))
    noise = np.einsum("nij,nj->ni", joints, ENCODER_RAD * rng.normal(size=(n, 6)))
    return joints, columns, (noise + READING_MM * rng.normal(size=(n, 3))).ravel()


def dense(covariance: Any) -> Any:
    n = len(covariance)
    whole = np.zeros((3 * n, 3 * n))
    for i, block in enumerate(covariance):
        whole[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
    return whole


@pytest.mark.parametrize("seed", [1, 2])
def test_rounds_of_fit_and_estimate_end_where_the_dense_likelihood_is_greatest(seed: int) -> None:
    joints, columns, measured = problem(seed)
    n = len(joints)

    def unlikely(logs: Any) -> float:
        covariance = dense(ReadingNoise(*np.exp(logs)).covariance(joints))
        inverse = np.linalg.inv(covariance)
        normal = columns.T @ inverse @ columns
        left = inverse - inverse @ columns @ np.linalg.solve(normal, columns.T @ inverse)
        dets = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1]
        return float(dets + measured @ left @ measured)

    start = np.log([ENCODER_RAD, READING_MM])
    likeliest = np.exp(
        minimize(unlikely, start, method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-9}).x
    )
    noise = ReadingNoise(1e-5, 0.03)
    for _ in range(40):
        whiten = make_whitening(noise.covariance(joints), np.ones(n))
        root, _ = np.linalg.qr((whiten @ columns.reshape(n, 3, -1)).reshape(3 * n, -1))
        white = (whiten @ measured.reshape(n, 3, 1)).ravel()
        rest = (white - root @ (root.T @ white)).reshape(n, 3, 1)
        residual = np.linalg.solve(whiten, rest)[:, :, 0]
        own = root.reshape(n, 3, -1)
        left = np.eye(3) - own @ own.transpose(0, 2, 1)
        noise = estimate_noise(residual, joints, whiten, left, np.ones(n, dtype=bool))
    assert (noise.encoder_rad, noise.reading_mm) == pytest.approx(tuple(likeliest), rel=1e-3)


def linearised(known: bool) -> Linearisation:
    arm = synthetic.arm()
    rng = np.random.default_rng(5)
    session = synthetic.session(
        arm, synthetic.disturbed(arm, rng), rng, readings=36, targets=3, known=known,
        distances=[(0, 1)], uncertainty_mm=0.01 * known,
    )  # fmt: skip
    observations = collect_observations([session], arm)
    position = compute_pose(observations.states.q, np.tile(arm.nominal(), (36, 1)))[0]
    return linearise(observations, arm.nominal(), [], fit_poses(observations, position), 20.0)


@pytest.mark.parametrize("known", [True, False])
def test_what_is_left_of_each_reading_is_that_of_the_dense_projection(known: bool) -> None:
    """Placements and targets free, what is certified of these below, and unknowns with a prior."""
    at = linearised(known)
    observations, n, floor = at.observations, at.observations.n, 0.02
    rng = np.random.default_rng(6)
    whiten = make_whitening(
        ReadingNoise(3e-5, 0.02).covariance(at.joints), rng.uniform(0.2, 1.0, n)
    )
    moves = at.make_constant_columns(list_free_constants(observations.arm)[:5]) * 0.01
    nuisances = np.zeros((n, 3, 18 + 9))
    for i in range(n):
        first = 6 * observations.placement[i]
        nuisances[i, :, first : first + 6] = at.pose_columns[i]
        first = 18 + 3 * observations.target[i]
        nuisances[i, :, first : first + 3] = at.target_columns[i]
    free = (whiten @ nuisances).reshape(3 * n, 27)
    # What is certified of the targets: positions to 10 µm, or one length to the floor.
    positions = at.poses.target_mm
    apart = positions[0] - positions[1]
    certified = np.vstack([np.eye(9) / 0.01, np.zeros((1, 9))]) if known else np.zeros((1, 9))
    certified[-1, :3] = apart / np.linalg.norm(apart) / floor
    certified[-1, 3:6] = -certified[-1, :3]
    free = np.vstack([free, np.hstack([np.zeros((len(certified), 18)), certified])])
    u, s, _ = np.linalg.svd(free, full_matrices=False)
    u = u[:, s > 1e-9 * s[0]]
    own = np.vstack([(whiten @ moves).reshape(3 * n, 5), np.zeros((len(certified), 5))])
    own = own - u @ (u.T @ own)
    left = np.eye(len(own)) - u @ u.T - own @ own.T
    found = ArmAlone(at, whiten, moves, floor).compute_residual_share(np.eye(5))
    wanted = [left[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(n)]
    np.testing.assert_allclose(found, wanted, atol=1e-8)

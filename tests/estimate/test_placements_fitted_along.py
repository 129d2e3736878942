"""Placements and targets fitted along with other columns, against dense algebra of all at once."""

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.estimate.observations import collect_observations
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.estimate.placements.placements import Placements
from armd.compensation.estimate.placements.poses import (
    compute_centres,
    make_pose_columns,
    make_target_columns,
)
from armd.compensation.model.kinematics import compute_pose
from support import synthetic

ARM = synthetic.arm()
N, TARGETS, PLACEMENTS = 48, 4, 3


def measured(known: bool) -> tuple[Placements, np.ndarray]:
    """Two sessions, what is known of their targets' positions to 0.5 mm; and dense whitened columns
    of all placements and targets, with one row for each certified coordinate."""
    rng = np.random.default_rng(5)
    truth = synthetic.disturbed(ARM, rng)
    sessions = [
        synthetic.session(
            ARM, truth, rng, readings=N // 2, targets=TARGETS, placements=PLACEMENTS, known=known,
            uncertainty_mm=0.5 * known, name=name,
        )
        for name in ("a", "b")
    ]  # fmt: skip
    observations = collect_observations(sessions, ARM)
    position = compute_pose(observations.states.q, np.tile(ARM.nominal(), (N, 1)))[0]
    poses = fit_poses(observations, position)
    placed = poses.compute_target_points(observations)
    whitening = rng.normal(size=(N, 3, 3)) + 3.0 * np.eye(3)
    certified = None
    if known:

        def certified(session: int) -> tuple[np.ndarray, np.ndarray]:
            return np.eye(3 * TARGETS) / 0.5, np.zeros(3 * TARGETS)

    problem = Placements(
        observations,
        make_pose_columns(observations, placed, compute_centres(observations, placed)),
        make_target_columns(observations, poses),
        np.arange(2 * TARGETS),
        [rng.normal(size=(N, 3, 2)), rng.normal(size=(N, 3, 1))],
        whitening,
        certified,
    )
    dense = np.zeros((N, 3, 6 * 2 * PLACEMENTS + 3 * 2 * TARGETS))
    for i in range(N):
        first = 6 * observations.placement[i]
        dense[i, :, first : first + 6] = problem.pose[i]
        first = 6 * 2 * PLACEMENTS + 3 * observations.target[i]
        dense[i, :, first : first + 3] = problem.target[i]
    rows = (whitening @ dense).reshape(3 * N, -1)
    if known:
        held = np.zeros((3 * 2 * TARGETS, rows.shape[1]))
        held[:, 6 * 2 * PLACEMENTS :] = np.eye(3 * 2 * TARGETS) / 0.5
        rows = np.vstack([rows, held])
    return problem, rows


@pytest.mark.parametrize("known", [True, False])
def test_what_is_left_and_what_follows_are_those_of_all_at_once(known: bool) -> None:
    """Of seats an artefact may stand anywhere in its own frame: six directions that nothing tells,
    in each session."""
    problem, rows = measured(known)
    others = (problem.whitening @ np.concatenate(problem.remaining_columns, axis=2)).reshape(
        3 * N, 3
    )
    others = np.vstack([others, np.zeros((len(rows) - 3 * N, 3))])
    found, *_ = np.linalg.lstsq(rows, -others, rcond=1e-9)
    clear = others + rows @ found
    np.testing.assert_allclose(problem.reduced_model.gram, clear.T @ clear, rtol=1e-9)
    assert problem.rank == np.linalg.matrix_rank(rows, tol=1e-9 * np.linalg.norm(rows))
    assert problem.rank == rows.shape[1] - 12 * (not known)
    amplitudes = np.array([0.3, -1.0, 2.0])
    twist, shift = problem.follow(amplitudes)
    answered = rows @ np.concatenate([twist.ravel(), shift.ravel()])
    np.testing.assert_allclose(others @ amplitudes + answered, clear @ amplitudes, atol=1e-8)


def test_a_session_left_out_whole_adds_nothing() -> None:
    """As if its readings, which weigh nothing, were worked through."""
    full_problem, _ = measured(known=False)
    inside = full_problem.observations.session == 1
    part = replace(
        full_problem,
        whitening=np.where(inside[:, None, None], full_problem.whitening, 0.0),
        free_targets=np.arange(TARGETS, 2 * TARGETS),
        full_problem=full_problem,
    )
    worked_through = replace(part, full_problem=None)
    np.testing.assert_array_equal(part.reduced_model.gram, worked_through.reduced_model.gram)
    assert part.rank == worked_through.rank
    for found, wanted in zip(
        part.follow(np.ones(3)), worked_through.follow(np.ones(3)), strict=True
    ):
        np.testing.assert_array_equal(found, wanted)


def test_seats_of_hundreds_of_placements_are_found() -> None:
    """The distances between the seats are those at which the arm met them, in one placement."""
    rng = np.random.default_rng(2)
    truth = synthetic.disturbed(ARM, rng)
    session = synthetic.session(
        ARM, truth, rng, readings=1200, targets=3, placements=300, spread_mm=80.0, known=False
    )
    observations = collect_observations([session], ARM)
    position = compute_pose(observations.states.q, np.tile(truth, (1200, 1)))[0]
    poses = fit_poses(observations, position)
    assert np.abs(poses.residual(observations, position)).max() < 1e-6
    one = observations.placement == 0
    met = np.array([position[one & (observations.target == k)][0] for k in range(3)])
    for a, b in ((0, 1), (0, 2), (1, 2)):
        apart = np.linalg.norm(poses.target_mm[a] - poses.target_mm[b])
        assert apart == pytest.approx(np.linalg.norm(met[a] - met[b]), abs=1e-6)

"""Orientations of a 6-D tracker beside its points: weighted by their own noise."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armd.arrays import F64
from armd.compensation.data.sessions.session import load_session, load_sessions
from armd.compensation.estimate.linearise import linearise
from armd.compensation.estimate.noise.reading import ReadingNoise, estimate_turn_noise
from armd.compensation.estimate.observations import TURN_MM, Observations, collect_observations
from armd.compensation.estimate.orientations import (
    add_orientation_rows,
    add_orientations,
    compute_observed,
    compute_turn_columns,
)
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.estimate.placements.poses import Poses
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.identify.orientation import compute_orientation_gain
from armd.compensation.identify.result import Result
from armd.compensation.model.arm import load_arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.cli import main
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from support.six_d_tracker import ENCODER_RAD, POINT_MM, TURN_RAD, write_six_d_session
from support.slopes import compute_pose_slopes, compute_target_slopes
from support.true_directions import errors_of


def prepared(folder: Path, seed: int, poses: int = 60, **more: float) -> tuple[Path, Path]:
    write_six_d_session(
        folder / "T", TrueArm.default(seed), np.random.default_rng(seed), poses, **more
    )
    (folder / "arm.toml").write_text(nominal.make_arm_toml(), encoding="utf-8")
    return folder / "T", folder / "arm.toml"


def calibrated(folder: Path, seed: int, poses: int = 60) -> Result:
    session, arm_file = prepared(folder, seed, poses)
    arm = load_arm(arm_file)
    return calibrate(load_sessions([session], arm), arm, Options())


def whole_of(folder: Path, poses: int = 8) -> Observations:
    session, arm_file = prepared(folder, 1, poses)
    arm = load_arm(arm_file)
    return add_orientations(collect_observations([load_session(session, arm)], arm))


def test_the_arm_is_better_known_and_within_what_is_stated(tmp_path: Path) -> None:
    found = calibrated(tmp_path, 1)
    gain = found.orientation
    assert gain is not None and gain.readings == 60
    assert gain.standard_deviation_rad == pytest.approx(TURN_RAD, rel=0.25)
    assert found.fit.noise.reading_mm == pytest.approx(POINT_MM, rel=0.25)
    assert gain.uncertainty_ratio < 0.8
    assert np.mean(errors_of(found, TrueArm.default(1)) ** 2) < 2.2
    assert found.fit.observations.n == 60  # readings, not rows
    assert found.certificate.granted
    # Points only: 0.02 mm per axis and the encoders', not what orientations miss by.
    reach_mm = ENCODER_RAD * 1000.0
    assert found.rms_um < 1e3 * np.sqrt(3.0) * np.hypot(POINT_MM, reach_mm)


def test_without_noise_of_the_tracker_angles_are_not_trusted_more_than_they_are(
    tmp_path: Path,
) -> None:
    """Orientations a hundred times worse than points add nothing, and spoil nothing."""
    session, arm_file = prepared(tmp_path, 3, turn_rad=0.02)
    arm = load_arm(arm_file)
    found = calibrate(load_sessions([session], arm), arm, Options())
    assert found.orientation is not None
    assert found.orientation.standard_deviation_rad == pytest.approx(0.02, rel=0.25)
    assert found.orientation.uncertainty_ratio == pytest.approx(1.0, abs=0.02)
    assert np.mean(errors_of(found, TrueArm.default(3)) ** 2) < 2.2


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_forty_arms_lie_within_their_stated_uncertainty_as_often_as_stated(tmp_path: Path) -> None:
    squares = []
    for seed in range(1, 41):
        folder = tmp_path / str(seed)
        folder.mkdir()
        squares.append(errors_of(calibrated(folder, seed), TrueArm.default(seed)) ** 2)
    every = np.concatenate(squares)
    within = float(np.mean(every < 1.96**2))
    assert abs(within - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / len(every))
    assert abs(every.mean() - 1.0) < 3.0 * np.sqrt(2.0 / len(every))


def test_each_orientation_is_a_row_of_its_own(tmp_path: Path) -> None:
    whole = whole_of(tmp_path)
    assert whole.n == 16 and whole.turned.tolist() == [False] * 8 + [True] * 8
    assert whole.row.tolist() == [*range(8), *range(8)]
    assert not whole.has_truth[8:].any() and whole.has_truth[:8].all()
    points = whole.rows(~whole.turned)
    chosen = add_orientation_rows(points, np.arange(8) < 3)
    assert np.flatnonzero(chosen).tolist() == [0, 1, 2, 8, 9, 10]


def test_a_turn_moves_as_its_columns_say(tmp_path: Path) -> None:
    """Central differences of the last frame's rotation, whose vector scipy takes."""
    arm = load_arm(prepared(tmp_path, 1, 4)[1])
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (3, 6))
    rows = np.tile(arm.nominal(), (3, 1))
    columns = compute_turn_columns(q, rows)
    for k in range(rows.shape[1]):
        step = np.zeros(rows.shape[1])
        step[k] = 1e-6
        ahead, behind = (compute_pose(q, rows + sign * step)[1] for sign in (1.0, -1.0))
        turn = Rotation.from_matrix(ahead @ behind.transpose(0, 2, 1)).as_rotvec()
        np.testing.assert_allclose(TURN_MM * turn / 2e-6, columns[:, :, k], atol=1e-5)


def test_residuals_follow_poses_and_bodies_as_their_columns_say(tmp_path: Path) -> None:
    whole = whole_of(tmp_path)
    constants = whole.arm.nominal()
    position = compute_observed(whole.states.q, np.tile(constants, (whole.n, 1)), whole.turned)
    poses = fit_poses(whole, position)
    at = linearise(whole, constants, [], poses, 20.0)

    def moved(poses: Poses) -> F64:
        return poses.residual(whole, position)[whole.turned]

    for found, columns in (
        (compute_pose_slopes(at, moved, 1e-3), at.pose_columns),
        (compute_target_slopes(at, moved, 1e-3), at.target_columns),
    ):
        np.testing.assert_allclose(found, columns[whole.turned], atol=5e-3)


def test_noise_of_turns_is_what_the_encoders_do_not_explain() -> None:
    rng, n = np.random.default_rng(5), 4000
    joints = rng.normal(0.0, 50.0, (n, 3, 6))
    residual = np.einsum("nij,nj->ni", joints, rng.normal(0.0, 1e-5, (n, 6)))
    residual += rng.normal(0.0, 0.004, (n, 3))
    left = np.tile(np.eye(3), (n, 1, 1))
    found = estimate_turn_noise(ReadingNoise(1e-5, 0.02), residual, joints, left, np.ones(n))
    assert found.turn_mm == pytest.approx(0.004, rel=0.05)
    assert found.reading_mm == 0.02


def test_urdfs_angles_are_the_same_orientation_as_quaternions(tmp_path: Path) -> None:
    turns = []
    for name, quaternions in (("a", True), ("b", False)):
        rng, folder = np.random.default_rng(4), tmp_path / name
        write_six_d_session(folder, TrueArm.default(1), rng, 5, quaternions=quaternions)
        (tmp_path / "arm.toml").write_text(nominal.make_arm_toml(), encoding="utf-8")
        turns.append(load_session(folder, load_arm(tmp_path / "arm.toml")).turn)
    assert turns[0] is not None and turns[1] is not None
    np.testing.assert_allclose(turns[0], turns[1], atol=1e-9)


def test_points_alone_gain_nothing(tmp_path: Path) -> None:
    session, arm_file = prepared(tmp_path, 1, 30)
    arm = load_arm(arm_file)
    plain = replace(load_session(session, arm), turn=None)
    found = calibrate([plain], arm, Options())
    assert found.orientation is None and compute_orientation_gain(found.fit) is None


def test_the_command_says_what_orientations_added(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    prepared(tmp_path, 1, 40)
    monkeypatch.chdir(tmp_path)
    words = ["calibrate", "T", "--arm", "arm.toml", "-o", "cal.json", "--json", "r.json"]
    assert main(words) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "40 orientations (0.00" in out and "leave the rank at 21" in out
    gain = json.loads(Path("r.json").read_text(encoding="utf-8"))["orientation"]
    assert gain["rank"] == gain["rank_without"] == 21 and gain["added"] == []
    assert main(["evaluate", "T", "--arm", "arm.toml", "--calibration", "cal.json"]) == 0
    assert "orientations take no part in these figures" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("columns", "cells", "words"),
    [
        ("qx,qy,qz,qw", "0,0,0,2", "column qx: found 2, expected a length of 1"),
        ("qx,qy,qz,qw", "0,0,,1", "column qz: found nan, expected a number, as in the other"),
        ("qx,qy,qz,qw,rx_deg,ry_deg,rz_deg", "0,0,0,1,0,0,0", "expected one of them"),
        ("qx,qy,qz", "0,0,0", "column qw: found no such column"),
    ],
)
def test_orientations_that_are_none_are_refused(
    columns: str, cells: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session, arm_file = prepared(tmp_path, 1, 4)
    table = session / "readings.csv"
    rows = [line.split(",")[:12] for line in table.read_text(encoding="utf-8").splitlines()]
    text = [",".join([*row, columns if i == 0 else cells]) for i, row in enumerate(rows)]
    table.write_text("\n".join(text) + "\n", encoding="utf-8")
    out = tmp_path / "cal.json"
    assert main(["calibrate", str(session), "--arm", str(arm_file), "-o", str(out)]) == 2
    assert words in capsys.readouterr().err
    assert not out.exists()

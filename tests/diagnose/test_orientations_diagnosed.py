"""`armd diagnose` of 6-D readings: orientations weighted by their own noise beside the points."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armd
from armd.compensation.data.sessions.session import load_sessions
from armd.compensation.diagnose.problem.linear import Linear, ModelState
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.diagnose.problem.rests import collect_rests, count_spare_rows
from armd.compensation.effects.effect import ArtefactChange
from armd.compensation.estimate.observations import TURN_MM
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import ArtefactCorrection
from armd.compensation.model.kinematics import compute_pose
from armd.simulator.plants.live import plant_in_arm
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from support.six_d_tracker import TURN_RAD, write_six_d_session


def measured(
    folder: Path, plants: Sequence[str], seed: int = 1, poses: int = 60, turn_rad: float = TURN_RAD
) -> Path:
    """Sessions *before* the plants and *now*, and the arm.toml beside them."""
    true, rng = TrueArm.default(seed), np.random.default_rng(seed)
    write_six_d_session(folder / "before", true, rng, poses, turn_rad=turn_rad)
    write_six_d_session(
        folder / "now", plant_in_arm(true, plants, seed), rng, poses, turn_rad=turn_rad
    )
    (folder / "arm.toml").write_text(nominal.make_arm_toml(), encoding="utf-8")
    return folder / "arm.toml"


def under_a_calibration(folder: Path, arm: Path) -> armd.Diagnosis:
    return armd.diagnose([folder / "now"], arm, armd.calibrate([folder / "before"], arm))


def turn_noise_rad(found: armd.Diagnosis) -> float:
    """Standard deviation of an orientation, as the diagnosis estimated it."""
    noise = found.details.search.last.noise
    return noise.turn_ratio * noise.scale_mm / TURN_MM


@pytest.mark.slow
def test_a_bad_encoder_is_found_with_orientations(tmp_path: Path) -> None:
    arm = measured(tmp_path, ["encoder_eccentricity@joint 6=20"], poses=40)
    found = under_a_calibration(tmp_path, arm)
    (finding,) = found.findings
    assert (finding.cause, finding.location) == ("encoder_eccentricity", "joint 6")
    assert turn_noise_rad(found) == pytest.approx(TURN_RAD, rel=0.3)
    # Figures are those of points: 0.02 mm per axis, and 1e-5 rad of encoders at up to a metre.
    assert 30.0 < found.baseline.noise_floor_um < 50.0
    assert finding.gain.heldout_rms_um_after < 1.3 * found.baseline.noise_floor_um


@pytest.mark.slow
@pytest.mark.parametrize("turn_rad", [TURN_RAD, 0.02])
@pytest.mark.parametrize(
    "plant",
    ["geometry_shift@joint 2=60", "geometry_shift@joint 5=60", "encoder_eccentricity@joint 3=4"],
)
def test_planted_causes_are_found(plant: str, turn_rad: float, tmp_path: Path) -> None:
    arm = measured(tmp_path, [plant], 3, turn_rad=turn_rad)
    found = under_a_calibration(tmp_path, arm)
    (finding,) = found.findings
    cause, location = plant.partition("=")[0].split("@")
    assert (finding.cause, finding.location) == (cause, location)
    assert finding.gain.heldout_rms_um_after < 0.6 * finding.gain.heldout_rms_um_before
    assert turn_noise_rad(found) == pytest.approx(turn_rad, rel=0.3)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_healthy_arm_has_no_more_findings_than_chance_makes(tmp_path: Path) -> None:
    """One in twenty, of a probability of 0.95: two of 24 arms at most."""
    findings, ratios = [], []
    for seed in range(1, 25):
        folder = tmp_path / str(seed)
        folder.mkdir()
        found = under_a_calibration(folder, measured(folder, [], seed))
        findings += found.findings
        ratios.append(found.baseline.rms_um / found.baseline.noise_floor_um)
    assert len(findings) <= 2
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
def test_an_orientation_gone_wrong_is_named_with_its_row(tmp_path: Path) -> None:
    arm = measured(tmp_path, ["encoder_eccentricity@joint 3=4"])
    path = tmp_path / "now" / "readings.csv"
    rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
    at = slice(rows[0].index("qx"), rows[0].index("qw") + 1)
    turn = Rotation.from_rotvec([0.05, 0.0, 0.0]) * Rotation.from_quat([*map(float, rows[17][at])])
    rows[17][at] = map(str, turn.as_quat())
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(rows)
    found = under_a_calibration(tmp_path, arm)
    assert [finding.cause for finding in found.findings] == ["encoder_eccentricity", "outliers"]
    assert "The orientation of now row 17 is off by 2.86°." in found.details.remarks


def linear_of(folder: Path, poses: int = 12) -> Linear:
    arm_file, true = measured(folder, [], poses=poses), TrueArm.default(1)
    arm_file.write_text(
        nominal.make_arm_toml(rows=true.rows, tip=true.tip_offset), encoding="utf-8"
    )
    arm = load_arm(arm_file)
    rests = collect_rests(load_sessions([folder / "now"], arm), arm)
    model = ModelState(arm.nominal(), (), 20.0, ArtefactCorrection())
    return linearise(rests, model, arm)


def test_a_moved_artefact_turns_the_orientations_with_its_points(tmp_path: Path) -> None:
    """All rests moved together are what the pose of the placement absorbs, and nothing else is."""
    linear = linear_of(tmp_path)
    rests = linear.rests
    assert rests.n == 24 and rests.points.n == 12
    # The placement's pose and the body's rotation are unknown.
    assert count_spare_rows(rests.observations) == 72 - 6 - 3
    moves = linear.artefact_columns(
        [ArtefactChange("moved", index=0, axis=axis, after=0) for axis in range(6)]
    ).to_dense(np.arange(6))
    pose = linear.nuisance.to_dense(np.arange(6))
    assert np.linalg.matrix_rank(pose) == 6
    left = moves - pose @ np.linalg.lstsq(pose, moves, rcond=1e-9)[0]
    assert np.abs(moves[36:]).max() == pytest.approx(TURN_MM)
    # The one turns targets, the other tips, which are as far apart as readings scatter.
    assert np.abs(left).max() < 3.0 * np.abs(linear.residual).max()
    assert np.abs(linear.residual).max() < 1e-3 * TURN_MM


def test_columns_of_orientations_are_how_the_last_frame_turns(tmp_path: Path) -> None:
    linear = linear_of(tmp_path)
    observations, step = linear.rests.observations, 1e-6
    arm = observations.arm
    turned = np.flatnonzero(observations.turned)
    q, rows = observations.states.q[turned], np.tile(arm.nominal(), (len(turned), 1))
    at = compute_pose(q, rows)[1]
    for name in ("theta_2", "alpha_3", "beta_5", "d_4", "tip_x"):
        moved = rows.copy()
        moved[:, arm.layout.index(name)] += step
        turn = Rotation.from_matrix(compute_pose(q, moved)[1] @ at.transpose(0, 2, 1)).as_rotvec()
        column = linear.jacobian[arm.layout.index(name), : 3 * linear.rests.n].reshape(-1, 3)
        assert np.allclose(column[turned], TURN_MM * turn / step, atol=1e-3), name

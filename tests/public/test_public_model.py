"""`armd.Model`: positions and their derivatives against chains of 4 × 4 matrices, the covariance
against sums over plain arrays."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armd
from armd.compensation.model.calibration import Calibration, save_calibration
from support import synthetic
from support.measured_arm import measured_arm
from support.plain_kinematics import tip_pose

NAMES = synthetic.arm().layout.names
SLOW = {"parameter": "a_2", "coefficient": 4e-3}
POSE = {"parameter": "theta_3", "coefficient": 3e-3}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """An arm.toml, and a calibration with a term of a temperature and one of a joint's angle."""
    folder = tmp_path_factory.mktemp("model")
    measured = measured_arm(folder)
    rng = np.random.default_rng(4)
    factors = rng.normal(size=(6, 6)) * 1e-5
    content: dict[str, Any] = {
        "arm": "SYN-1",
        "created": "2026-01-01T00:00:00+00:00",
        "reference_temperature_c": 20.0,
        "constants": dict(zip(NAMES, synthetic.disturbed(measured.arm, rng).tolist(), strict=True)),
        "terms": [
            SLOW | {"basis": [{"kind": "temperature", "weights": {"t2": 1.0}, "lag_s": 900.0}]},
            POSE | {"basis": [{"kind": "sin", "joint": 3}]},
        ],
        "covariance_of": ["theta_1", "d_3", "a_2", "tip_z", "term 0", "term 1"],
        "covariance": (factors @ factors.T).tolist(),
        "noise": {"encoder_rad": [1e-6] * 6, "reading_mm": 2e-3},
    }
    text = json.dumps(content)
    save_calibration(folder / "cal.json", Calibration.model_validate_json(text))
    return measured.arm_file, folder / "cal.json"


def parameter_rows(calibration: armd.Calibration, q: np.ndarray, celsius: np.ndarray) -> np.ndarray:
    """Parameters (n, P) by the definition of a term."""
    constants = calibration.to_dict()["constants"]
    rows = np.tile([constants[name] for name in NAMES], (len(q), 1))
    rows[:, NAMES.index("a_2")] += SLOW["coefficient"] * (celsius[:, 1] - 20.0)
    rows[:, NAMES.index("theta_3")] += POSE["coefficient"] * np.sin(q[:, 2])
    return rows


def some_rows(n: int = 7) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    return rng.uniform(-2, 2, (n, 6)), rng.uniform(15, 30, (n, 6))


def test_pose_and_jacobian_are_those_of_the_chain(files: tuple[Path, Path]) -> None:
    calibration = armd.read_calibration(files[1])
    model = armd.Model(files[0], calibration)
    q, celsius = some_rows()
    poses = tip_pose(q, parameter_rows(calibration, q, celsius))
    assert model.position(q, celsius) == pytest.approx(poses[:, :3, 3], abs=1e-9)
    turned = Rotation.from_quat(model.orientation(q, celsius)).as_matrix()
    assert turned == pytest.approx(poses[:, :3, :3], abs=1e-12)
    jacobian = model.jacobian(q, celsius)
    assert jacobian.shape == (7, 3, 6)
    for k in range(6):
        step = 1e-6 * np.eye(6)[k]
        ahead, behind = (
            tip_pose(q + sign * step, parameter_rows(calibration, q + sign * step, celsius))
            for sign in (1, -1)
        )
        change = (ahead - behind)[:, :3, 3] / 2e-6
        assert jacobian[:, :, k] == pytest.approx(change, abs=1e-5)  # of differences: 1e-10 / 1e-6


def test_covariance_is_the_sum_over_its_parts(files: tuple[Path, Path]) -> None:
    calibration = armd.read_calibration(files[1])
    q, celsius = some_rows()

    def moved(name: str, q_: np.ndarray) -> np.ndarray:
        """The tip's motion (n, 3) per unit of a parameter, by differences."""
        step = np.zeros(len(NAMES))
        step[NAMES.index(name)] = 1e-5
        rows = parameter_rows(calibration, q_, celsius)
        difference: np.ndarray = (tip_pose(q_, rows + step) - tip_pose(q_, rows - step))[:, :3, 3]
        return difference / 2e-5

    columns = {name: moved(name, q) for name in ("theta_1", "d_3", "a_2", "tip_z")}
    columns["term 0"] = columns["a_2"] * (celsius[:, 1:2] - 20.0)
    columns["term 1"] = moved("theta_3", q) * np.sin(q[:, 2:3])
    jacobian = np.stack([columns[name] for name in calibration.covariance_of], axis=2)
    expected = jacobian @ calibration.covariance @ jacobian.transpose(0, 2, 1)
    encoders = np.stack([moved(f"theta_{k}", q) for k in range(1, 7)], axis=2)
    expected += 1e-12 * encoders @ encoders.transpose(0, 2, 1) + 4e-6 * np.eye(3)
    found = armd.Model(files[0], calibration).covariance(q, celsius)
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-13)
    assert np.isnan(armd.Model(files[0]).covariance(q, celsius)).all()


def test_without_temperatures_it_is_at_the_reference(files: tuple[Path, Path]) -> None:
    model = armd.Model(*files)
    q, _ = some_rows()
    assert (model.position(q) == model.position(q, np.full(6, 20.0))).all()
    missing = np.full((7, 6), 20.0)
    missing[2, 1] = np.nan
    assert np.isnan(model.position(q, missing)).any(axis=1).tolist() == [i == 2 for i in range(7)]
    assert np.isnan(model.orientation(q, missing)[2]).all()
    assert np.isnan(model.jacobian(q, missing)[2]).all()
    assert model.position(np.empty((0, 6))).shape == (0, 3)


def test_other_shapes_are_refused(files: tuple[Path, Path]) -> None:
    model = armd.Model(*files)
    with pytest.raises(ValueError, match=r"q has shape \(5,\), expected \(n, 6\)"):
        model.position(np.zeros(5))
    with pytest.raises(ValueError, match=r"temperatures have shape \(2,\), expected \(3, 6\)"):
        model.position(np.zeros((3, 6)), np.zeros(2))
    with pytest.raises(ValueError, match="q: int too large to convert to float"):
        model.position([[10**400, 0, 0, 0, 0, 0]])
    with pytest.raises(ValueError, match="temperatures: int too large"):
        model.position(np.zeros((1, 6)), [[10**400, 0, 0, 0, 0, 0]])


def test_another_arms_calibration_is_refused(files: tuple[Path, Path], tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text(files[0].read_text().replace("SYN-1", "SYN-2"))
    with pytest.raises(armd.BadInput, match=r"cal\.json: arm: found 'SYN-1', expected 'SYN-2'"):
        armd.Model(other, files[1])


def test_commands_bring_the_tip_where_it_is_wanted(files: tuple[Path, Path]) -> None:
    """Of an arm of six joints, orientation kept; a row out of reach is NaN."""
    model, drawn = armd.Model(*files), armd.Model(files[0])
    rng = np.random.default_rng(8)
    q = rng.uniform(-1.2, 1.2, (20, 6))
    celsius = rng.uniform(15.0, 30.0, (20, len(synthetic.arm().sensors)))
    wanted = drawn.position(q)
    commands = model.compensate(q, temperatures=celsius)
    ok = np.isfinite(commands).all(axis=1)
    assert ok.sum() > 10
    reached = model.position(commands, celsius)[ok]
    np.testing.assert_allclose(reached, wanted[ok], atol=1e-6, rtol=0.0)
    turned = Rotation.from_quat(model.orientation(commands[ok], celsius[ok]))
    kept = Rotation.from_quat(drawn.orientation(q[ok]))
    assert (turned * kept.inv()).magnitude().max() < 1e-9
    wanted[0] = [1e5, 0.0, 0.0]
    far = model.compensate(q, wanted, celsius)
    assert np.isnan(far[0]).all()
    np.testing.assert_allclose(far[1:], commands[1:], atol=1e-9)
    with pytest.raises(ValueError, match=r"wanted_mm has shape \(1, 3\), expected \(20, 3\)"):
        model.compensate(q, wanted[:1])

"""Pinocchio reads the URDFs that `armd model` writes: its tip and its Jacobian are armd's."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armd.arrays import F64
from armd.compensation.geometry.geometry import compute_geometry
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import load_calibration, save_calibration
from armd.compensation.model.kinematics import compute_jacobian, compute_pose
from armd.daemon.catalogue.known_arms import KNOWN, read_arm_text
from armd.daemon.catalogue.urdf.urdf import compute_denavit_hartenberg, read_chain
from armd.daemon.cli import main
from armd.files.toml_text import format_toml
from armd.offline.model import Model
from support.drawn import drawn
from support.own_urdf import OWN
from support.selection import parametrize_default

pinocchio = pytest.importorskip("pinocchio", reason="the package pin is not installed")

#: Of the position in mm, of the rotation in rad, of the Jacobian in mm/rad.
EXACT = 1e-9
POSTURES = 50
#: Pinocchio's parser wants limits of a finger, and passes over a quaternion.
AS_URDFDOM = [
    ('<mimic joint="finger"', '<limit upper="1" effort="1" velocity="1"/><mimic joint="finger"'),
    ('quat_xyzw="0 0.70710678118654757 0 0.70710678118654757"', 'rpy="0 1.5707963267948966 0"'),
]
#: A disc off its axis, a joint that gives way, a length that grows.
TERMS: list[dict[str, Any]] = [
    {"parameter": "theta_3", "basis": [{"kind": "sin", "joint": 3}], "coefficient": 4e-4},
    {"parameter": "theta_2", "basis": [{"kind": "cos", "joint": 2}], "coefficient": -6e-4},
    {"parameter": "a_2", "basis": [{"kind": "temperature", "weights": {}}], "coefficient": 0.02},
]


class Peer:
    """A URDF as Pinocchio has it."""

    def __init__(self, path: Path, tip: str, *apart: str) -> None:
        """*apart*: joints that do not move the tip."""
        whole: Any = pinocchio.buildModelFromUrdf(str(path))
        locked = [whole.getJointId(name) for name in apart]
        self._model: Any = pinocchio.buildReducedModel(whole, locked, pinocchio.neutral(whole))
        self._data: Any = self._model.createData()
        self._tip: int = self._model.getFrameId(tip)
        self.joints: int = self._model.nv

    def tip(self, q: F64) -> tuple[F64, F64, F64]:
        """Positions (n, 3) in mm, rotations (n, 3, 3), Jacobians (n, 3, N) in mm/rad."""
        positions, rotations, jacobians = [], [], []
        frame = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        for row in q:
            # A joint without limits has the cosine and the sine of its angle as coordinates.
            at = pinocchio.integrate(self._model, pinocchio.neutral(self._model), row)
            columns = pinocchio.computeFrameJacobian(self._model, self._data, at, self._tip, frame)
            pinocchio.framesForwardKinematics(self._model, self._data, at)
            placed = self._data.oMf[self._tip]
            positions.append(1e3 * placed.translation)
            rotations.append(placed.rotation.copy())
            jacobians.append(1e3 * columns[:3])
        return np.array(positions), np.array(rotations), np.array(jacobians)


def calibrate(folder: Path, arm: Arm, terms: list[dict[str, Any]]) -> Path:
    """Writes a calibration with each constant off its drawing."""
    rng = np.random.default_rng(arm.n_joints)
    values, layout = arm.nominal(), arm.layout
    values += np.where(layout.are_lengths, 1.0, 4e-3) * rng.normal(size=layout.count)
    ranges = dict.fromkeys(arm.sensors[:1], (15.0, 25.0))
    calibration = drawn(arm, values=values, terms=terms, temperature_range_c=ranges)
    return save_calibration(folder / "cal.json", calibration).path


def terms_of(arm: Arm) -> list[dict[str, Any]]:
    """`TERMS`, the length's by the arm's first sensor if it has one."""
    terms = json.loads(json.dumps(TERMS))
    if arm.sensors:
        terms[2]["basis"][0]["weights"] = {arm.sensors[0]: 1.0}
        return terms
    return terms[:2]


def postures(arm: Arm, n: int = POSTURES) -> F64:
    rng = np.random.default_rng(8)
    return np.vstack([np.zeros(arm.n_joints), rng.uniform(*arm.range_rad, (n, arm.n_joints))])


def write(arm_path: Path, calibration: Path, output: Path, *options: object) -> None:
    words = [str(arm_path), "--calibration", str(calibration), "-o", str(output)]
    assert main(["model", *words, *map(str, options), "-q"]) == 0


def assert_same(peer: Peer, arm: Arm, parameters: F64, base: F64 | None = None) -> None:
    """Pinocchio's tip against armd's with *parameters*, whose base stands at *base* (4, 4)."""
    base = np.eye(4) if base is None else base
    q = postures(arm)
    position, rotation, derivatives = peer.tip(q)
    assert peer.joints == arm.n_joints
    own_position, own_rotation = compute_pose(q, parameters)
    columns = compute_jacobian(q, parameters)[1][:, :, arm.layout.angles]
    turn = base[:3, :3]
    assert np.abs(position - base[:3, 3] - own_position @ turn.T).max() < EXACT
    held = np.swapaxes(turn @ own_rotation, 1, 2) @ rotation
    assert np.abs(held - held[0]).max() < EXACT  # the tip's link is turned against armd's frame
    assert np.abs(derivatives - turn @ columns).max() < EXACT


@parametrize_default("kind", ["plain", "extended"])
@parametrize_default("name", list(KNOWN))
def test_a_known_arm(name: str, kind: str, tmp_path: Path) -> None:
    """A new URDF, and the drawing's URDF corrected; what an extended calibration leaves out is as
    large as `armd model` says, between Pinocchio's tip and the corrected one."""
    (tmp_path / "arm.toml").write_text(read_arm_text(name), encoding="utf-8")
    arm = load_arm(tmp_path / "arm.toml")
    path = calibrate(tmp_path, arm, terms_of(arm) if kind == "extended" else [])
    tip = f"{arm.serial_number.replace('-', '_')}_ball"
    write(tmp_path / "arm.toml", path, tmp_path / "new.urdf", "--at-c", 23)
    geometry = compute_geometry(arm, load_calibration(path, arm).content, 23.0)
    peer = Peer(tmp_path / "new.urdf", tip)
    assert_same(peer, arm, geometry.parameters)
    assert (
        main(["model", str(tmp_path / "arm.toml"), "-o", str(tmp_path / "drawn.urdf"), "-q"]) == 0
    )
    like = ("--like", tmp_path / "drawn.urdf", "--at-c", 23)
    write(tmp_path / "arm.toml", path, tmp_path / "like.urdf", *like)
    assert_same(Peer(tmp_path / "like.urdf", tip), arm, geometry.parameters)
    q = postures(arm, 2000)
    celsius = np.full(len(arm.sensors), 23.0)
    model = Model(str(tmp_path / "arm.toml"), str(path))
    left_mm = np.linalg.norm(model.position(q, celsius) - peer.tip(q)[0], axis=1)
    rms_mm = math.sqrt((left_mm**2).mean())
    assert rms_mm == pytest.approx(geometry.left_out.rms_mm, rel=0.05, abs=EXACT)
    assert (rms_mm > 1e-3) == (kind == "extended")


@pytest.mark.parametrize("terms", [[], TERMS[:2]], ids=["plain", "extended"])
def test_a_persons_own_urdf(terms: list[dict[str, Any]], tmp_path: Path) -> None:
    """With a stand below the first joint, joints without limits, and fingers beside the chain."""
    path = tmp_path / "own.urdf"
    text = OWN
    for old, new in AS_URDFDOM:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    into = ["-o", str(tmp_path / "arm.toml"), "-q"]
    assert main(["import", str(path), "--tip-link", "tool0", *into]) == 0
    arm = load_arm(tmp_path / "arm.toml")
    calibration = calibrate(tmp_path, arm, terms)
    like = ("--like", path, "--tip-link", "tool0")
    write(tmp_path / "arm.toml", calibration, tmp_path / "new.urdf", *like)
    geometry = compute_geometry(arm, load_calibration(calibration, arm).content, None)
    chain = read_chain(path, "tool0")
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = compute_denavit_hartenberg(chain)[2], chain.origins[0]
    peer = Peer(tmp_path / "new.urdf", "tool0", "finger", "other_finger")
    assert_same(peer, arm, geometry.parameters, base)


def test_a_chain_of_twenty_joints(tmp_path: Path) -> None:
    joint = {"d_mm": 60.0, "a_mm": 90.0, "alpha_deg": 65.0, "min_deg": -150.0, "max_deg": 150.0}
    content = {
        "schema": "armd.arm/1", "serial_number": "LONG", "joint": [joint] * 20,
        "tip": {"offset_mm": [10.0, 20.0, 80.0]},
    }  # fmt: skip
    (tmp_path / "arm.toml").write_text(format_toml(content))
    arm = load_arm(tmp_path / "arm.toml")
    calibration = calibrate(tmp_path, arm, [])
    write(tmp_path / "arm.toml", calibration, tmp_path / "new.urdf")
    geometry = compute_geometry(arm, load_calibration(calibration, arm).content, None)
    assert_same(Peer(tmp_path / "new.urdf", "LONG_ball"), arm, geometry.parameters)

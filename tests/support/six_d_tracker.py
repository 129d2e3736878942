"""A 6-D tracker on the simulator's arm: place and orientation of a body on the last link."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from armd.arrays import F64
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.effects.effect import Conditions

#: Standard deviations per axis of the tracker's point and orientation, and of the encoders.
POINT_MM, TURN_RAD, ENCODER_RAD = 0.02, 5e-5, 1e-5


def last_frame(true: TrueArm, q: F64) -> Rotation:
    """How the last frame is turned at angles (n, N), effects included: by the ends of its axes."""
    still = Conditions.at_rest(len(q), q.shape[1])
    ends = [replace(true, tip_offset=at).tip(q, still) for at in (np.zeros(3), *np.eye(3))]
    return Rotation.from_matrix(np.stack([end - ends[0] for end in ends[1:]], axis=2))


def write_six_d_session(
    folder: Path,
    true: TrueArm,
    rng: np.random.Generator,
    poses: int = 60,
    *,
    quaternions: bool = True,
    turn_rad: float = TURN_RAD,
) -> None:
    """Write session.toml and readings.csv; orientations as quaternions, or as URDF's angles."""
    q = rng.uniform(*nominal.get_limits_rad(), (poses, 6))
    still = Conditions.at_rest(poses, 6)
    tip, frame = true.tip(q, still), last_frame(true, q)
    placed, body = Rotation.random(2, random_state=int(rng.integers(1 << 30)))
    where = np.array([1500.0, 300.0, 500.0])
    seen = placed.inv().apply(tip - where) + rng.normal(0.0, POINT_MM, (poses, 3))
    turned = placed.inv() * frame * body
    turned = Rotation.from_rotvec(rng.normal(0.0, turn_rad, (poses, 3))) * turned
    read = true.encoder_angles(q, still) + rng.normal(0.0, ENCODER_RAD, q.shape)
    names = ["qx", "qy", "qz", "qw"] if quaternions else ["rx_deg", "ry_deg", "rz_deg"]
    told = turned.as_quat() if quaternions else turned.as_euler("ZYX", degrees=True)[:, ::-1]
    folder.mkdir(parents=True)
    with (folder / "readings.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        joints = [f"q{k + 1}" for k in range(6)]
        writer.writerow(["time_s", "placement", "target", *joints, "x_mm", "y_mm", "z_mm", *names])
        for i in range(poses):
            row = np.concatenate([read[i], seen[i], told[i]]).tolist()
            writer.writerow([10.0 * i, "T", "SMR", *row])
    (folder / "session.toml").write_text(
        f'schema = "armd.session/1"\narm = "{nominal.SERIAL_NUMBER}"\n'
        'started = 2026-03-01T09:00:00Z\n[artefact]\nname = "tracker"\n'
        '[[artefact.target]]\nname = "SMR"\n',
        encoding="utf-8",
    )

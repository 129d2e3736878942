"""The true SO-101: its own chain of printed parts, and its encoders.

The chain is the robot description's (origin and axis of each joint), not armd's rows; each printed
part departs from it. Between an encoder and its link are a horn with play and parts that bend under
gravity. The encoder itself is a magnet beside its axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64
from armd.simulator.truth.rotations import rotate_about

COUNTS_PER_TURN = 4096
GRAVITY = 9.80665
REFERENCE_C = 20.0
PLA_PER_K = 70e-6
#: The joints' origins in the link before them: mm, and roll, pitch, yaw in quarter turns except
#: the twist of the last one. TheRobotStudio/SO-ARM100, so101_new_calib.urdf. z is the axis.
ORIGINS_MM = np.array(
    [
        (0.0, 0.0, 62.4),  # from armd's base frame, on the first axis
        (-30.3992, -18.2778, -54.2),
        (-112.57, -28.0, 0.0),
        (-134.9, 5.2, 0.0),
        (0.0, -61.1, 18.1),
    ]
)
_QUARTER = math.pi / 2
TURNS_RAD = np.array(
    [
        (2 * _QUARTER, 0.0, -2 * _QUARTER),
        (-_QUARTER, -_QUARTER, 0.0),
        (0.0, 0.0, _QUARTER),
        (0.0, 0.0, -_QUARTER),
        (_QUARTER, 0.0486795, 2 * _QUARTER),
    ]
)
TIP_MM = np.array([-7.9, -0.218121, -98.1274])  # the gripper frame, where the ball is
MASS_KG = np.array([0.100, 0.103, 0.104, 0.079, 0.099])
CENTRE_MM = np.array(
    [
        (-30.76, -0.02, -25.27),
        (-89.85, -8.38, 18.41),
        (-98.07, 3.24, 18.28),
        (-0.10, -38.61, 28.12),
        (2.45, 0.16, -28.6),
    ]
)
LIMITS_DEG = np.array([(-110, 110), (-100, 100), (-96.8, 96.8), (-95, 95), (-157, 162)], float)


@dataclass(frozen=True)
class PrintedArm:
    """A printed arm of five joints. Angles are the description's, rad."""

    shift_mm: F64  # (5, 3) of each printed part
    tilt_rad: F64  # (5, 3)
    tip_mm: F64  # (3,)
    horn_rad: F64  # (5,): offset of the horn from the middle
    eccentricity: F64  # (5, 2): the magnet's offset over the sensors' radius
    second_rad: F64  # (5, 2): second harmonic, cosine and sine
    stiffness_nm: F64  # (5,) per rad
    play_rad: F64  # (5,) either way

    @classmethod
    def draw(cls, rng: np.random.Generator) -> PrintedArm:
        """Draw an arm with the usual errors of printing and assembly."""
        around = rng.uniform(0, 2 * np.pi, (2, 5))
        magnet = rng.uniform(0.002, 0.008, 5)  # up to half a degree
        twice = np.radians(rng.uniform(0.03, 0.12, 5))
        return cls(
            shift_mm=rng.normal(0.0, 0.5, (5, 3)),
            tilt_rad=np.radians(rng.normal(0.0, 0.3, (5, 3))),
            tip_mm=TIP_MM + rng.normal(0.0, 0.7, 3),
            horn_rad=np.radians(rng.normal(0.0, 1.0, 5)),
            eccentricity=magnet[:, None] * np.stack([np.cos(around[0]), np.sin(around[0])], 1),
            second_rad=twice[:, None] * np.stack([np.cos(around[1]), np.sin(around[1])], 1),
            stiffness_nm=rng.uniform(120.0, 250.0, 5),
            play_rad=np.radians(rng.uniform(0.02, 0.06, 5)),
        )

    def as_json(self) -> dict[str, list[float]]:
        """Return the values that a diagnosis should find, as plain data."""
        second_of_arc = math.pi / 180 / 3600
        return {
            "encoder_eccentricity_arcsec": [
                float(np.hypot(*e) / second_of_arc) for e in self.eccentricity
            ],
            "encoder_ellipticity_arcsec": [
                float(np.hypot(*e) / second_of_arc) for e in self.second_rad
            ],
            "stiffness_nm_per_rad": self.stiffness_nm.tolist(),
            "play_deg": np.degrees(self.play_rad).tolist(),
        }

    def tip(self, angles: F64, link_c: F64) -> F64:
        """Return the ball's centre (3,) mm for the angles (5,) of the encoders."""
        torque = self._torques(angles)
        loose = self.play_rad * np.tanh(torque / 0.01)
        return self.tip_of_links(angles + torque / self.stiffness_nm + loose, link_c)

    def tip_of_links(self, angles: F64, link_c: F64) -> F64:
        """Return the ball's centre (3,) mm for the angles (5,) of the links."""
        frames = self._frames(angles, link_c)
        growth = 1 + PLA_PER_K * (link_c[4] - REFERENCE_C)
        tip: F64 = frames[-1][:3, 3] + frames[-1][:3, :3] @ self.tip_mm * growth
        return tip

    def counts(self, angles: F64, rng: np.random.Generator) -> I64:
        """Return the positions that the servos send (5,): whole counts from the middle."""
        encoder_rad = angles + self.horn_rad
        magnet = np.arctan2(
            np.sin(encoder_rad) - self.eccentricity[:, 1],
            np.cos(encoder_rad) - self.eccentricity[:, 0],
        )
        magnet = encoder_rad + (magnet - encoder_rad + np.pi) % (2 * np.pi) - np.pi
        magnet += self.second_rad[:, 0] * np.cos(2 * encoder_rad) + self.second_rad[:, 1] * np.sin(
            2 * encoder_rad
        )
        noisy = magnet / (2 * np.pi) * COUNTS_PER_TURN + rng.normal(0.0, 0.3, 5)
        return np.rint(noisy).astype(np.int64)

    def _frames(self, angles: F64, link_c: F64) -> list[F64]:
        """Return each joint's child frame (4, 4)."""
        frame, frames = np.eye(4), []
        for k in range(5):
            # The part that carries joint k is the link before it.
            growth = 1 + PLA_PER_K * (link_c[max(k - 1, 0)] - REFERENCE_C)
            step = np.eye(4)
            step[:3, 3] = (ORIGINS_MM[k] + self.shift_mm[k]) * growth
            roll, pitch, yaw = TURNS_RAD[k]
            turn = _about(2, yaw) @ _about(1, pitch) @ _about(0, roll)
            step[:3, :3] = turn @ rotate_about(self.tilt_rad[k]) @ _about(2, angles[k])
            frame = frame @ step
            frames.append(frame)
        return frames

    def _torques(self, angles: F64) -> F64:
        """Return gravity's torques about each joint's axis (5,) Nm, positive with the angle."""
        frames = self._frames(angles, np.full(5, REFERENCE_C))
        centres = [f[:3, 3] + f[:3, :3] @ c for f, c in zip(frames, CENTRE_MM, strict=True)]
        torques = np.zeros(5)
        for k, frame in enumerate(frames):
            kg = MASS_KG[k:]
            x, y, _ = kg @ (np.array(centres[k:]) - frame[:3, 3]) / 1000
            torques[k] = GRAVITY * (x * frame[1, 2] - y * frame[0, 2])  # lever × (0, 0, −g) · axis
        return torques


def _about(axis: int, angle: float) -> F64:
    i, j = ((1, 2), (2, 0), (0, 1))[axis]
    turn = np.eye(3)
    turn[i, i] = turn[j, j] = math.cos(angle)
    turn[j, i], turn[i, j] = math.sin(angle), -math.sin(angle)
    return turn

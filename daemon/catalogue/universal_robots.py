"""Universal Robots' `default_kinematics.yaml`, as their ROS description reads it.

Each joint's frame is placed in the one before it by x, y, z (m) and roll, pitch, yaw (rad), and
turns about its z. That is a row of the modified convention: Tx(a)·Rx(α)·Ry(β) of the joint before
and Rz(θ)·Tz(d) of its own. The file cannot hold anything that follows the last joint.
"""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_frames
from armd.daemon.catalogue.axes import make_turn
from armd.daemon.catalogue.urdf.roll_pitch_yaw import convert_matrix_to_rpy

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
#: A smaller value (mm, rad) counts as zero.
NOTHING = 1e-9
FIRST_LINE = "# Written by armd model"


def write_kinematics_yaml(arm: Arm, parameters: F64, name: str, identity: str) -> str:
    """Return the file's text.

    *name* of the arm is for its comment, *identity* for its hash.
    """
    lines = [f"{FIRST_LINE}: {name}", "kinematics:"]
    origins, rotations = (
        part[0] for part in compute_frames(np.zeros((1, arm.n_joints)), parameters)
    )
    before_turn, before_origin = np.eye(3), np.zeros(3)
    for k, link in enumerate(LINKS):
        theta, d = parameters[arm.layout.joint(k + 1)][:2]
        rotation = rotations[k] @ make_turn(2, float(np.degrees(theta)))
        origin = origins[k] + d * rotations[k][:, 2]
        step = before_turn.T @ rotation
        numbers = [*(1e-3 * before_turn.T @ (origin - before_origin)), *convert_matrix_to_rpy(step)]
        lines.append(f"  {link}:")
        lines += [
            f"    {key}: {_format_number(float(value))}"
            for key, value in zip(KEYS, numbers, strict=True)
        ]
        before_turn, before_origin = rotation, origin
    return "\n".join([*lines, f"  hash: armd_{identity}", ""])


def describe_omitted(arm: Arm, parameters: F64) -> list[str]:
    """List the values after the last joint's z that are not zero: `a_6 = 0.3 mm`."""
    names = [f"{name}_{arm.n_joints}" for name in ("a", "alpha", "beta")]
    names += ["tip_x", "tip_y", "tip_z"]
    lines = []
    for name in names:
        index = arm.layout.index(name)
        value, length = float(parameters[index]), bool(arm.layout.are_lengths[index])
        if abs(value) > NOTHING:
            lines.append(f"{name} = {value:.10g} {'mm' if length else 'rad'}")
    return lines


def _format_number(value: float) -> str:
    """Format a number so that YAML 1.1 reads it as one; it takes 1e-05 for a text."""
    text = repr(value + 0.0)
    mantissa, e, exponent = text.partition("e")
    return text if not e or "." in mantissa else f"{mantissa}.0e{exponent}"

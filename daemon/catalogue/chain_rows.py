"""Convert the rows of a chain to another form that places every point equally."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import PARALLEL_DEG
from armd.daemon.catalogue.axes import (
    convert_axes_to_rows,
    convert_rows_to_axes,
    format_point,
    make_turn,
)

#: A row's parameters in arm.toml, in the order in which armd applies them.
DH = ("theta_deg", "d_mm", "a_mm", "alpha_deg", "beta_deg")
OF_THE_LINK = DH[2:]
#: A longer row, in mm, comes from nearly parallel axes: no arm is so long.
TOO_LONG_MM = 10_000.0
#: Decimals that are kept of mm and degrees; further ones are rounding errors.
PLACES = 9


@dataclass(frozen=True)
class ChainRows:
    """The joints as in arm.toml, in armd's convention unless stated otherwise."""

    joints: list[dict[str, Any]]
    after: Mapping[str, Any] | None = None  # a row after the last joint, without an angle
    first: Sequence[float] = (0.0, 0.0, 0.0)  # a, α, β before the first joint

    def tip_offset(self) -> list[float]:
        """Return the end of the row after the last joint, mm, in the last joint's frame."""
        if self.after is None:
            return [0.0, 0.0, 0.0]
        theta, d, a = (float(self.after.get(name, 0.0)) for name in DH[:3])
        x, y = a * math.cos(math.radians(theta)), a * math.sin(math.radians(theta))
        return [round(value, PLACES) + 0.0 for value in (x, y, d)]

    def gravity(self) -> list[float]:
        """Return the direction of gravity in armd's base frame, which is the first axis's."""
        down = self._turned().T @ np.array([0.0, 0.0, -1.0])
        return [round(value, 12) + 0.0 for value in down.tolist()]

    def tip_text(self) -> str:
        """Return the tip at zero angles in the table's base frame: `(805, 0, 1180) mm …`."""
        _, _, end = convert_rows_to_axes(_list_parameters(self.joints))
        tip = end + _compute_last_frame(self.joints) @ np.array(self.tip_offset())
        point = np.array([self.first[0], 0.0, 0.0]) + self._turned() @ tip
        return f"{format_point(point)} mm in the table's base frame"

    def _turned(self) -> F64:
        """Return the rotation (3, 3) of armd's base frame in the table's."""
        _, alpha, beta = self.first
        return make_turn(0, alpha) @ make_turn(1, beta)


def to_standard_rows(rows: ChainRows, remarks: list[str]) -> ChainRows:
    """Convert modified rows to standard ones.

    The a, α, β of a modified row move up one row, to the link that they describe.
    """
    shifted: list[dict[str, Any]] = []
    after = rows.after or {}
    for joint, link in zip(rows.joints, [*rows.joints[1:], after], strict=True):
        joint_values = {key: value for key, value in joint.items() if key not in OF_THE_LINK}
        shifted.append(joint_values | {key: link[key] for key in OF_THE_LINK if key in link})
    first = [float(rows.joints[0].get(name, 0.0)) for name in OF_THE_LINK]
    if any(first):
        remarks.append(
            "armd's base frame stands on the first axis, after the first row's alpha and a;"
            " gravity is turned with it"
        )
    tip_values = {key: after[key] for key in DH[:2] if key in after}
    return ChainRows(shifted, tip_values or None, first)


def convert_to_hayati(rows: ChainRows, remarks: list[str]) -> ChainRows:
    """Replace rows of nearly parallel axes, kilometres long, by Hayati's rows.

    Those have a β and no length d.
    """
    parameters = _list_parameters(rows.joints)
    nearly = [
        0.0 < abs(math.sin(math.radians(row[3]))) < math.sin(math.radians(PARALLEL_DEG))
        for row in parameters[:-1]
    ]
    if not any(nearly) or max(abs(x) for row in parameters for x in row[1:3]) < TOO_LONG_MM:
        return rows
    origins, axes, tip = convert_rows_to_axes(parameters)
    frame = _compute_last_frame(rows.joints)
    offset = tip + frame @ np.array(rows.tip_offset())
    hayati_rows, made_tip = convert_axes_to_rows(origins, axes, offset, np.array([1.0, 0.0, 0.0]))
    joints = []
    for joint, row in zip(rows.joints, hayati_rows.tolist(), strict=True):
        values = {name: round(x, PLACES) + 0.0 for name, x in zip(DH, row, strict=True)}
        joints.append(joint | values)
    remarks.append("nearly parallel axes have Hayati's rows, with beta_deg and without a long d_mm")
    x, y, z = (round(value, PLACES) + 0.0 for value in made_tip.tolist())
    theta, a = math.degrees(math.atan2(y, x)), math.hypot(x, y)
    return replace(rows, joints=joints, after={"theta_deg": theta, "d_mm": z, "a_mm": a})


def _list_parameters(joints: Sequence[Mapping[str, Any]]) -> list[list[float]]:
    return [[float(joint.get(name, 0.0)) for name in DH] for joint in joints]


def _compute_last_frame(joints: Sequence[Mapping[str, Any]]) -> F64:
    """Return the rotation (3, 3) of the frame after the last joint, at zero angles."""
    rotation: F64 = np.eye(3)
    for theta, _, _, alpha, beta in _list_parameters(joints):
        rotation = rotation @ make_turn(2, theta) @ make_turn(0, alpha) @ make_turn(1, beta)
    return rotation

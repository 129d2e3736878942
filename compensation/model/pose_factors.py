"""The pose factors of a basis, whose values differ from sample to sample: one class for each kind.

Each class holds what a calibration file stores, the value at many readings, and the code by which
the kernel knows it. The kernel evaluates it for every sample. The compiled code of a kind is in
`kernel.pose_factors`; a test compares it with the value here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from armd.arrays import F64
from armd.compensation.model.curve import compute_curve_pieces, evaluate_curve
from armd.compensation.model.parameters import MOST_JOINTS
from armd.files.schema import Strict

if TYPE_CHECKING:
    from armd.compensation.model.instants import Instants

JointNumber = Annotated[int, Field(ge=1, le=MOST_JOINTS)]
Axis = Literal["x", "y", "z"]
AXES = "xyz"


class PoseFactor(Strict):
    """A factor whose value differs from sample to sample."""

    def evaluate(self, instants: Instants) -> F64:
        """Evaluate the factor (n,) at each instant; a missing rate or approach gives 0."""
        raise NotImplementedError

    def pose_code(self, table_at: int) -> tuple[str, int, int]:
        """Return the factor's code for `kernel.pose_factors`.

        That is the kind there, the joint or link from 0, and a detail. *table_at* is where the rows
        of its table begin, if it has one.
        """
        raise NotImplementedError

    def table(self) -> F64:
        """Return rows (pieces, 4) of cubic polynomials for the compiled code."""
        return np.zeros((0, 4))


class Harmonic(PoseFactor):
    """sin(order·q) or cos(order·q) of a joint's angle (as read: before its θ offset)."""

    kind: Literal["sin", "cos"]
    joint: JointNumber
    order: Annotated[int, Field(ge=1, le=64)] = 1

    def evaluate(self, instants: Instants) -> F64:
        turn = self.order * instants.q[:, self.joint - 1]
        return np.sin(turn) if self.kind == "sin" else np.cos(turn)

    def pose_code(self, table_at: int) -> tuple[str, int, int]:
        return self.kind, self.joint - 1, self.order


class Angle(PoseFactor):
    """q^power of a joint's angle in rad, as read."""

    kind: Literal["angle"] = "angle"
    joint: JointNumber
    power: Annotated[int, Field(ge=1, le=4)] = 1

    def evaluate(self, instants: Instants) -> F64:
        return instants.q[:, self.joint - 1] ** self.power

    def pose_code(self, table_at: int) -> tuple[str, int, int]:
        return "angle", self.joint - 1, self.power


class Curve(PoseFactor):
    """A periodic cubic spline through equidistant values over a joint's turn."""

    kind: Literal["curve"] = "curve"
    joint: JointNumber
    values: Annotated[list[float], Field(min_length=4, max_length=512)]

    def evaluate(self, instants: Instants) -> F64:
        return evaluate_curve(self.values, instants.q[:, self.joint - 1])

    def pose_code(self, table_at: int) -> tuple[str, int, int]:
        return "curve", self.joint - 1, table_at

    def table(self) -> F64:
        return compute_curve_pieces(self.values)


class GravityTorque(PoseFactor):
    """The gravity torque about a joint's axis in Nm, from the masses of arm.toml and the pose."""

    kind: Literal["gravity_torque"] = "gravity_torque"
    joint: JointNumber

    def evaluate(self, instants: Instants) -> F64:
        return instants.gravity_torques[:, self.joint - 1]

    def pose_code(self, table_at: int) -> tuple[str, int, int]:
        return "torque", self.joint - 1, 0


class GravityDirection(PoseFactor):
    """The component of the unit gravity vector along an axis of a joint's outgoing link frame."""

    kind: Literal["gravity_direction"] = "gravity_direction"
    link: JointNumber
    axis: Axis

    def evaluate(self, instants: Instants) -> F64:
        return instants.gravity_directions[:, self.link - 1, AXES.index(self.axis)]

    def pose_code(self, table_at: int) -> tuple[str, int, int]:
        return "direction", self.link - 1, AXES.index(self.axis)


class GravityMoment(PoseFactor):
    """The gravity moment in Nm of everything beyond a link, about an axis of its outgoing frame.

    It is about the origin of that frame (the link's end), and zero for the last link, which carries
    nothing.
    """

    kind: Literal["gravity_moment"] = "gravity_moment"
    link: JointNumber
    axis: Axis

    def evaluate(self, instants: Instants) -> F64:
        return instants.gravity_moments[:, self.link - 1, AXES.index(self.axis)]

    def pose_code(self, table_at: int) -> tuple[str, int, int]:
        return "moment", self.link - 1, AXES.index(self.axis)


class Side(PoseFactor):
    """The side of approach: the sign of the joint's last motion (−1, 0 unknown, +1)."""

    kind: Literal["side"] = "side"
    joint: JointNumber

    def evaluate(self, instants: Instants) -> F64:
        return np.sign(instants.rate[:, self.joint - 1])

    def pose_code(self, table_at: int) -> tuple[str, int, int]:
        return "side", self.joint - 1, 0


class Rate(PoseFactor):
    """The joint rate in rad/s."""

    kind: Literal["rate"] = "rate"
    joint: JointNumber

    def evaluate(self, instants: Instants) -> F64:
        return instants.rate[:, self.joint - 1]

    def pose_code(self, table_at: int) -> tuple[str, int, int]:
        return "rate", self.joint - 1, 0


class Approach(PoseFactor):
    """A component of the unit approach vector: base frame ("base") or last frame ("tip")."""

    kind: Literal["approach"] = "approach"
    axis: Axis
    frame: Literal["base", "tip"] = "base"

    def evaluate(self, instants: Instants) -> F64:
        approach = instants.approach if self.frame == "base" else instants.approach_of_tip
        return approach[:, AXES.index(self.axis)]

    def pose_code(self, table_at: int) -> tuple[str, int, int]:
        return "approach" if self.frame == "base" else "approach_tip", 0, AXES.index(self.axis)


AnyPoseFactor = (
    Harmonic
    | Angle
    | Curve
    | GravityTorque
    | GravityDirection
    | GravityMoment
    | Side
    | Rate
    | Approach
)

"""What a physical imperfection may do to an arm: every hook leaves things as they are."""

from __future__ import annotations

from armd.arrays import F64
from armd.simulator.truth.conditions import Conditions
from armd.simulator.truth.posture import Posture
from armd.simulator.truth.rotations import SmallMotion


class Effect:
    """One physical imperfection of the arm.

    A subclass overrides the hooks its physics act through. Joints and links count from 1.
    """

    def shown(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        """What the encoder of *joint* adds to the true angles phi (n, N): (n,) rad."""
        return None

    def base(self, conditions: Conditions) -> SmallMotion | None:
        """Motion of the mount, in the base frame."""
        return None

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        """Motion of the axis of *joint*, in the frame it stands in (before it turns)."""
        return None

    def link(self, link: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        """Deformation at the end of *link*, in the frame that turns with its joint."""
        return None

    def strain(self, link: int, conditions: Conditions) -> F64 | None:
        """Relative change (n,) of the lengths of *link*, beyond its linear expansion."""
        return None

    def tip(self, posture: Posture, conditions: Conditions) -> F64 | None:
        """Displacement (n, 3) mm of the tip's centre, in the base frame."""
        return None

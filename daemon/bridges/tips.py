"""The tips of an arm, and the direction out of the material, for hosts of CMMs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from armd.arrays import Vector


@dataclass(frozen=True)
class CmmTip:
    """A tip: a ball on a shaft."""

    offset_mm: Vector
    """Centre of the ball in the last frame."""
    radius_mm: float


class Tips:
    """The tips by their names in armd.toml; None is the calibration's own tip."""

    def __init__(self, info: Mapping[str, Any]) -> None:
        """Read the tips from the arm's `info`."""
        active_tip = info["arm"]["tip"]
        radius_mm = active_tip["radius_mm"]
        self.by_name: dict[str | None, CmmTip] = {
            None: CmmTip(parse_vector(active_tip["offset_mm"]), radius_mm)
        }
        for name, tip in info["configuration"]["tips"].items():
            tip_radius_mm = tip.get("radius_mm")
            self.by_name[name] = CmmTip(
                parse_vector(tip["offset_mm"]),
                radius_mm if tip_radius_mm is None else tip_radius_mm,
            )

    @property
    def names(self) -> list[str]:
        """The names in armd.toml, in its order."""
        return [name for name in self.by_name if name is not None]

    def get(self, name: str | None) -> CmmTip:
        """Return a tip by name; an unknown name gives the arm's own tip.

        A tip that was configured since has an unknown name.
        """
        return self.by_name.get(name) or self.by_name[None]

    def used_in(self, measurement: Mapping[str, Any]) -> CmmTip:
        """Return the tip of a measurement with its values at that time.

        The tip may have been calibrated again since. A measurement without values gives today's
        tip.
        """
        offset_mm, radius_mm = measurement.get("tip_offset_mm"), measurement.get("tip_radius_mm")
        if offset_mm is None or radius_mm is None:
            return self.get(measurement["tip"])
        return CmmTip(parse_vector(offset_mm), radius_mm)

    def out_of_material(self, measurement: Mapping[str, Any]) -> Vector:
        """Return a unit vector: back along the travel before the rest, else the shaft's."""
        if measurement["approach"] is not None:
            x, y, z = measurement["approach"]
            return 0.0 - x, 0.0 - y, 0.0 - z  # not -0.0
        return compute_shaft(measurement["orientation"], self.used_in(measurement))


def compute_shaft(orientation: Any, tip: CmmTip) -> Vector:
    """Return the unit vector from the tip to the wrist, base frame.

    *orientation* is x y z w of the last frame. A tip at the last frame's origin has its shaft along
    that frame's z.
    """
    length = math.hypot(*tip.offset_mm)
    along = tuple(x / length for x in tip.offset_mm) if length > 0 else (0.0, 0.0, 1.0)
    return rotate(orientation, (-along[0], -along[1], -along[2]))


def rotate(quaternion: Any, v: Vector) -> Vector:
    """Rotate *v* by a unit quaternion x y z w."""
    x, y, z, w = quaternion
    # v + 2 w (u × v) + 2 u × (u × v), u the vector part
    tx, ty, tz = 2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


def parse_vector(values: Any) -> Vector:
    """Convert three values of JSON to a vector."""
    x, y, z = values
    return x, y, z

"""A cause to plant, with its place and its size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from armd.errors import BadInput

Detail = Mapping[str, float | str]


@dataclass(frozen=True)
class Plant:
    """A cause to plant: "joint 3", "link 2", "sensor t4", …; size in the cause's unit.

    `detail` fixes properties that are otherwise drawn: `order`, `direction`, `parameter`, …; and
    `distortion` changes an effect's form from the textbook's by that share.
    """

    cause: str
    location: str
    size: float
    detail: Detail = field(default_factory=dict)

    @property
    def number(self) -> int:
        """The joint or link of the location."""
        return int(self.location.split()[-1])


def parse_plant(text: str) -> Plant:
    """Parse `cause@location=size`, such as ``encoder_eccentricity@joint 3=0.8``."""
    cause, at_sign, rest = text.partition("@")
    location, equals, size = rest.rpartition("=")
    try:
        if not (at_sign and equals):
            raise ValueError
        return Plant(cause, location, float(size))
    except ValueError:
        raise BadInput("--plant", text, "this text", "cause@location=size") from None


def list_columns(plant: Plant) -> list[str]:
    """List the columns of a session on which a planted cause depends."""
    place = plant.location.split()[-1]
    if plant.cause == "unknown":
        joint, other_joint = (plant.detail.get(k, v) for k, v in (("joint", 2), ("other", 3)))
        return {
            "cable": [f"q{joint}", f"q{other_joint}"],
            "hysteresis": [f"w{joint}", f"q{other_joint}"],
            "wear": [f"w{joint}", "time_s"],
            "bristles": [f"w{joint}", f"q{joint}", "time_s"],
            "drag": [f"w{joint}"],
            "letting go": [f"w{joint}"],
            "wide hysteresis": [f"w{joint}", f"q{joint}", "time_s"],
            "two wheels": [f"q{joint}", f"q{other_joint}"],
            "warm neighbour": [f"w{joint}", "time_s"],
        }[str(plant.detail.get("kind", "cable"))]
    match plant.cause:
        case "joint_backlash" | "time_skew":
            return [f"w{place}"]
        case "encoder_thermal":
            return [f"q{place}", f"t{place}"]
        case "gear_mesh":
            return [f"q{k}" for k in range(1, 10) if abs(k - int(place)) <= 1]
        case "self_heating":
            return [f"w{place}", "time_s"]
        case "stylus_sag":
            return [f"q{k}" for k in range(2, 10)]
        case "artefact_sag":
            return ["placement", "target"]
        case "encoder_slip" | "mount_drift":
            return ["time_s"]
        case "joint_thermal" | "link_expansion" | "nonlinear_expansion" | "thermal_lag":
            return [f"t{place}"]
        case "sensor_offset" | "sensor_swapped":
            return plant.location.removeprefix("sensors ").removeprefix("sensor ").split(", ")
        case "artefact_expansion":
            return ["artefact_c"]
        case "artefact_length":
            return ["target"]
    return [f"q{place}"] if plant.location.startswith("joint") else []

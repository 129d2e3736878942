"""The location of a cause (a joint, a link, a sensor, the tip, …) as a value, not as a text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

LocationKind = Literal[
    "joint",
    "link",
    "tip",
    "base",
    "artefact",
    "target",
    "sensor",
    "sensors",
    "parameter",
    "shape",
    "rows",
]


@dataclass(frozen=True)
class Location:
    """One location; `str` is its name in results and calibration files."""

    kind: LocationKind
    name: str = ""  # of a target or of sensors; the function of a parameter
    joint: int | None = None  # its number (1…N), for a link that of the joint before it
    origin: tuple[str, Location] | None = None  # of a shape: its cause and location

    def __str__(self) -> str:
        if self.origin is not None:
            cause, location = self.origin
            return f"shape of {cause} {location}"
        if self.kind == "parameter":
            return self.name
        return f"{self.kind} {self.name or self.joint or ''}".strip()


TIP, BASE, ARTEFACT = Location("tip"), Location("base"), Location("artefact")
ROWS = Location("rows")  # of a table of readings


def joint(number: int) -> Location:
    """Return the location of a joint (1…N): its encoder, its axis."""
    return Location("joint", joint=number)


def link(number: int) -> Location:
    """Return the location of the link (1…N) that its joint turns."""
    return Location("link", joint=number)


def target(name: str) -> Location:
    """Return the location of a target of the artefact."""
    return Location("target", name)


def sensors(*names: str) -> Location:
    """Return the location of one temperature sensor, or of several together."""
    return Location("sensor" if len(names) == 1 else "sensors", ", ".join(names))


def parameter(number: int, function: str) -> Location:
    """Return the location of an unnamed effect on a parameter of a joint (1…N): d_2(q1).

    *function* is that text.
    """
    return Location("parameter", function, number)


def make_shape_location(cause: str, location: Location) -> Location:
    """Return the location of a cause's shape, if it differs from that of the catalogue."""
    return Location("shape", origin=(cause, location))

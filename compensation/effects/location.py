"""Where a cause acts: a joint, a link, a sensor, the tip, … as a value, no text to take apart."""

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
    """One place; `str` is what results and calibration files call it."""

    kind: LocationKind
    name: str = ""  # of a target or of sensors; what of a parameter
    joint: int | None = None  # its number (1…N), of a link the joint's before it
    origin: tuple[str, Location] | None = None  # of a shape: the cause and location whose it is

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
    """A joint (1…N): its encoder, its axis."""
    return Location("joint", joint=number)


def link(number: int) -> Location:
    """The link (1…N) that its joint turns."""
    return Location("link", joint=number)


def target(name: str) -> Location:
    """A target of the artefact."""
    return Location("target", name)


def sensors(*names: str) -> Location:
    """One temperature sensor, or several together."""
    return Location("sensor" if len(names) == 1 else "sensors", ", ".join(names))


def parameter(number: int, function: str) -> Location:
    """What moves a parameter of a joint (1…N) without a name, as a *function*: d_2(q1)."""
    return Location("parameter", function, number)


def make_shape_location(cause: str, location: Location) -> Location:
    """The shape of what a cause does at a place, where it is not quite the catalogue's."""
    return Location("shape", origin=(cause, location))

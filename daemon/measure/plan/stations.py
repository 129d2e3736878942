"""The plan of a guided measurement: stations, one reading each, in measuring order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import ValidationError

from armd.compensation.data.sessions.format import Artefact
from armd.compensation.model.arm import Arm
from armd.errors import BadInput
from armd.files.schema import Strict, validate

PlanKind = Literal["seats", "artefact", "verify", "poses", "tip", "interim", "repeatability"]
KINDS: tuple[PlanKind, ...] = get_args(PlanKind)

#: A reading farther than this (mm) from its target's position counts as another target's.
NEAR_MM = 5.0
#: For coarse encoders that distance is so many of their steps, at a metre.
NEAR_STEPS = 20.0
MOST_STATIONS = 10_000

#: Places for an artefact, one placement after another: a calibration is valid where the arm was
#: measured, so each should be in another part of its reach.
PLACES = (
    "in front of the arm, at table height",
    "to the left, turned by a quarter",
    "to the right, higher, tilted",
    "close to the column, low",
    "far out, as high as the arm reaches it",
    "behind the arm, tilted the other way",
)


class Station(Strict):
    """One reading: at this target, with the artefact in this placement."""

    placement: str
    target: str
    how: str = ""  # how to touch it, for a person
    posture_deg: tuple[float, ...] | None = None  # joint angles as read, from `armd design`


class Plan(Strict):
    """The whole plan of a guided measurement, with which the log begins."""

    kind: PlanKind
    artefact: Artefact
    stations: list[Station]
    near_mm: float = NEAR_MM
    #: Whether temperatures outside the calibration's range, or changing fast, invalidate a reading:
    #: true where the calibrated arm is judged; such readings are useful where it is calibrated.
    within_calibration: bool = False
    #: Diameter of a sphere touched from outside (kind tip); None: the tip is in a seat.
    sphere_mm: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the plan as JSON data."""
        return self.model_dump(mode="json", by_alias=True, exclude_defaults=True)

    def place_in_words(self, placement: str) -> str:
        """Describe where the artefact should stand, for kinds that let the person choose."""
        names = list(dict.fromkeys(station.placement for station in self.stations))
        if self.kind != "artefact" or placement not in names:
            return ""
        return PLACES[names.index(placement) % len(PLACES)]


@dataclass(frozen=True)
class Wishes:
    """The user's choices for a plan; None: the kind's default."""

    targets: Sequence[str] | None = None
    placements: Sequence[str] | None = None
    repeats: int | None = None
    poses: Path | None = None
    proposed: Path | None = None  # a history of interim checks: the check that it proposes
    tests: Sequence[str] | None = None
    near_mm: float | None = None
    sphere_mm: float | None = None


def compute_near_mm(arm: Arm) -> float:
    """Return the limit of a reading's distance from its target, for an uncalibrated arm."""
    turns = [joint.counts_per_turn for joint in arm.joint if joint.counts_per_turn]
    step_mm = 1000.0 * math.tau / min(turns) if turns else 0.0
    return max(NEAR_MM, NEAR_STEPS * step_mm)


def plan_rounds(
    placements: Sequence[str], targets: Sequence[str], repeats: int, how: str = ""
) -> list[Station]:
    """Plan rounds over all targets, in one placement after another.

    No target of several is touched twice in a row, so that the arm's posture differs each time.
    """
    return [
        Station(placement=placement, target=target, how=how)
        for placement in placements
        for _ in range(repeats)
        for target in targets
    ]


def make_seats_artefact(names: Sequence[str]) -> Artefact:
    """Return an artefact of fixed points at unknown positions."""
    targets = [{"name": name} for name in dict.fromkeys(names)]
    return validate("the seats", {"name": "seats", "target": targets}, Artefact)


def parse_plan(source: str, content: object) -> Plan:
    """Parse a plan from the log; raises `BadInput`."""
    try:
        return Plan.model_validate(content)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in fault["loc"])
        raise BadInput(source, f"plan.{key}", repr(fault["input"])[:60], fault["msg"]) from error

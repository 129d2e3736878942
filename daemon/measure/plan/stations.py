"""What a guided measurement consists of: stations, one reading each, in the order to go to them."""

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

#: Farther than this from where its target must be, a reading is taken for another target's (mm).
NEAR_MM = 5.0
#: Coarse encoders put the tip that many of their steps off, at a metre.
NEAR_STEPS = 20.0
MOST_STATIONS = 10_000

#: Where an artefact should stand, one placement after another: a calibration holds where the arm
#: was, so that each should be another part of its reach.
PLACES = (
    "in front of the arm, at table height",
    "to the left, turned by a quarter",
    "to the right, higher, tilted",
    "close to the column, low",
    "far out, as high as the arm reaches it",
    "behind the arm, tilted the other way",
)


class Station(Strict):
    """One reading: at this target, the artefact standing in this placement."""

    placement: str
    target: str
    how: str = ""  # to touch it, for a person
    posture_deg: tuple[float, ...] | None = None  # joint angles as read, of `armd design`


class Plan(Strict):
    """A guided measurement, whole: what the log begins with."""

    kind: PlanKind
    artefact: Artefact
    stations: list[Station]
    near_mm: float = NEAR_MM
    #: Whether temperatures outside the calibration's range, or changing fast, spoil a reading: they
    #: do where the arm as it is calibrated is judged, and are wanted where it is calibrated.
    within_calibration: bool = False
    #: Of a sphere that the tip touches from outside (kind tip); None: the tip stands in a seat.
    sphere_mm: float | None = None

    def to_json(self) -> dict[str, Any]:
        """As JSON."""
        return self.model_dump(mode="json", by_alias=True, exclude_defaults=True)

    def place_in_words(self, placement: str) -> str:
        """Where the artefact should stand, for kinds that leave it to the person."""
        names = list(dict.fromkeys(station.placement for station in self.stations))
        if self.kind != "artefact" or placement not in names:
            return ""
        return PLACES[names.index(placement) % len(PLACES)]


@dataclass(frozen=True)
class Wishes:
    """What a person may choose; None: as the kind has it."""

    targets: Sequence[str] | None = None
    placements: Sequence[str] | None = None
    repeats: int | None = None
    poses: Path | None = None
    proposed: Path | None = None  # a history of interim checks: the check that it proposes
    tests: Sequence[str] | None = None
    near_mm: float | None = None
    sphere_mm: float | None = None


def compute_near_mm(arm: Arm) -> float:
    """How far from its target a reading of this arm may lie, uncalibrated."""
    turns = [joint.counts_per_turn for joint in arm.joint if joint.counts_per_turn]
    step_mm = 1000.0 * math.tau / min(turns) if turns else 0.0
    return max(NEAR_MM, NEAR_STEPS * step_mm)


def plan_rounds(
    placements: Sequence[str], targets: Sequence[str], repeats: int, how: str = ""
) -> list[Station]:
    """Round after round over all targets, in one placement after another: no target is touched
    twice running, so that the arm stands otherwise each time."""
    return [
        Station(placement=placement, target=target, how=how)
        for placement in placements
        for _ in range(repeats)
        for target in targets
    ]


def make_seats_artefact(names: Sequence[str]) -> Artefact:
    """Points that nobody knows, fixed where they are."""
    targets = [{"name": name} for name in dict.fromkeys(names)]
    return validate("the seats", {"name": "seats", "target": targets}, Artefact)


def parse_plan(source: str, content: object) -> Plan:
    """A plan as the log has it; raises `BadInput`."""
    try:
        return Plan.model_validate(content)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in fault["loc"])
        raise BadInput(source, f"plan.{key}", repr(fault["input"])[:60], fault["msg"]) from error

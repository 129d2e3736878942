"""An operator who follows a plan: the seats and balls of an artefact in the simulated world.

The operator brings the tip to each target in turn, each time in another posture. It comes to rest a
little beside the target, and the button is pressed. The targets' positions and the size of the
misses are in the plan; nothing on the wire reveals them.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, Field, model_validator

from armd.arrays import F64, Vector
from armd.errors import BadInput
from armd.files.schema import Strict, load_toml
from armd.simulator.live.operator import Hand, Stretch
from armd.simulator.measured import plan as visits
from armd.simulator.measured.placement import Placement, place
from armd.simulator.measured.poses import Reach, Unreachable, solve_posture
from armd.simulator.truth.arm import Movable
from armd.simulator.truth.effects.effect import Conditions
from armd.simulator.truth.rotations import rotate_about

#: Peak speeds of a hand at a normal pace; the plan's `haste` multiplies them.
TIP_MM_S, JOINT_RAD_S = 400.0, 3.0
SHORTEST_MOVE_S = 0.25


#: Limits in mm and degrees, within which sums of squares and sines stay accurate.
_Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
_PlanPoint = tuple[_Coordinate, _Coordinate, _Coordinate]
_Angle = Annotated[float, Field(ge=-3600, le=3600)]
#: The longest rest or wait: a day.
LONGEST_S = 86_400.0


class LedTarget(Strict):
    """A point of the artefact."""

    name: str
    position_mm: _PlanPoint = (0.0, 0.0, 0.0)


class LedVisit(Strict):
    """The artefact in one placement: its targets in order, round after round."""

    placement: str
    targets: list[str] = []  # none: all
    rounds: Annotated[int, Field(ge=1, le=100)] = 1
    #: Position of the artefact's origin, base frame. None: one where the arm reaches all targets.
    position_mm: _PlanPoint | None = None
    #: Rotations about the base's x, then y, then z.
    rotation_deg: tuple[_Angle, _Angle, _Angle] = (0.0, 0.0, 0.0)
    #: Without a position: permitted distances of the targets from the column's axis.
    radius_mm: tuple[_Coordinate, _Coordinate] = (200.0, 1000.0)


#: The schema of a plan.
OPERATOR = "armd.operator/1"


class OperatorPlan(Strict):
    """The plan of an operator, `schema = "armd.operator/1"`."""

    schema_: Literal["armd.operator/1"] = Field(alias="schema")
    #: A file beside the plan with the table [artefact] of a session, instead of [[target]].
    artefact: str | None = None
    target: list[LedTarget] = []
    visit: Annotated[list[LedVisit], Field(min_length=1)]
    #: Standard deviation per axis of the resting tip from the target.
    miss_um: Annotated[float, Field(ge=0, le=1e6)] = 0.5
    #: Duration of a rest, and time until the button is pressed.
    rest_s: Annotated[float, Field(gt=0, le=LONGEST_S)] = 1.2
    press_after_s: Annotated[float, Field(gt=0, le=LONGEST_S)] = 0.8
    haste: Annotated[float, Field(gt=0, le=5)] = 1.0
    start_s: Annotated[float, Field(ge=0, le=LONGEST_S)] = 1.5  # before the first move
    #: Begin again after the last visit; otherwise the hand rests at the last target for ever.
    again: bool = True

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.press_after_s >= self.rest_s:
            raise ValueError(f"press_after_s below rest_s, not {self.press_after_s:g} s")
        if (self.artefact is None) == (not self.target):
            raise ValueError("either artefact = FILE or [[target]]")
        return self


class _Position(BaseModel):
    """The part of a target in an artefact's file that a hand needs."""

    name: str
    position_mm: _PlanPoint


class _Table(BaseModel):
    target: list[_Position]


class _ArtefactFile(BaseModel):
    artefact: _Table


@dataclass(frozen=True)
class Led:
    """A plan that was read, with the points of its artefact by name."""

    plan: OperatorPlan
    points_mm: dict[str, Vector]


def load_plan(path: Path) -> Led:
    """Read a plan and its artefact; raises `BadInput` naming file, key, found and expected."""
    plan = load_toml(path, OperatorPlan)
    if plan.artefact is None:
        points = {target.name: target.position_mm for target in plan.target}
    else:
        table = load_toml(path.parent / plan.artefact, _ArtefactFile).artefact
        points = {target.name: target.position_mm for target in table.target}
    for i, visit in enumerate(plan.visit, 1):
        for name in visit.targets:
            if name not in points:
                expected = f"a target: {', '.join(list(points)[:20])}"
                raise BadInput(path, f"visit[{i}].targets", repr(name), expected)
    return Led(plan, points)


class _Stop(NamedTuple):
    """One target to rest at."""

    goal_mm: F64  # (3,) base frame
    posture: F64  # (N,) a posture that reaches it approximately


class LedOperator(Hand):
    """A hand that follows a plan, the same way for the same *seed*."""

    def __init__(
        self, arm: Movable, led: Led, seed: int, limits_rad: tuple[F64, F64] | None = None
    ) -> None:
        """Plan the stops within *limits_rad* (N,) each; None: those of the demo arm.

        Raises `BadInput` for a target out of reach.
        """
        self._plan = led.plan
        self._rng = np.random.default_rng([seed, 0x1ED])
        once = list(_stops(led, Reach(arm, self._rng, limits_rad), self._rng))
        self._stops: Iterator[_Stop] = itertools.cycle(once) if led.plan.again else iter(once)
        super().__init__(arm, once[0].posture)
        self.first = Stretch(
            0.0, 1e-9, led.plan.start_s or 1e-9, once[0].posture, 0.0 * once[0].posture, np.inf
        )

    def plan_next(self, before: Stretch, link_c: F64) -> Stretch:
        begin, start_s = before.begin + before.change, before.end_s
        stop = next(self._stops, None)
        if stop is None:
            return Stretch(start_s, 1e-9, np.inf, begin, 0.0 * begin, np.inf)
        missed = stop.goal_mm + self._rng.normal(0.0, 1e-3 * self._plan.miss_um, 3)
        still = Conditions.at_rest(1, len(begin), link_c)
        posture = solve_posture(self._arm, stop.posture[None], missed[None], still)[0]
        change = posture - begin
        move_s = max(self._shortest_s(begin, change, link_c), SHORTEST_MOVE_S)
        end_s = start_s + move_s + self._plan.rest_s
        return Stretch(start_s, move_s, end_s, begin, change, self._plan.press_after_s)

    def _shortest_s(self, begin: F64, change: F64, link_c: F64) -> float:
        tip_s, joint_s = self._durations(begin, change, link_c, TIP_MM_S, JOINT_RAD_S)
        return max(tip_s, joint_s) / self._plan.haste


def _stops(led: Led, reach: Reach, rng: np.random.Generator) -> Iterator[_Stop]:
    """Yield all targets in the order of the plan, with a posture for each.

    Like a hand, it takes the remaining posture of a target that is nearest to the present one.
    """
    stands: F64 | None = None
    for i, visit in enumerate(led.plan.visit, 1):
        names = visit.targets or list(led.points_mm)
        local = np.array([led.points_mm[name] for name in names])
        try:
            placement, postures = _placed(visit, local, reach, rng)
        except Unreachable as error:
            location = f"visit[{i}] {visit.placement}"
            raise BadInput(
                "the operator's plan", location, str(error), "targets in reach"
            ) from error
        goals = placement.to_base(local)
        remaining_postures = [list(postures_of_goal) for postures_of_goal in postures]
        for _ in range(visit.rounds):
            for goal, postures_of_goal in zip(goals, remaining_postures, strict=True):
                away = [
                    0.0 if stands is None else np.abs(q - stands).max() for q in postures_of_goal
                ]
                stands = postures_of_goal.pop(int(np.argmin(away)))
                yield _Stop(goal, stands)


def _placed(
    visit: LedVisit, local_mm: F64, reach: Reach, rng: np.random.Generator
) -> tuple[Placement, F64]:
    """Return the artefact's placement, and postures (K, rounds, N) for its targets (K, 3)."""
    if visit.position_mm is None:
        somewhere = visits.Visit(
            visit.placement,
            (),
            visit.rounds,
            radius_mm=visit.radius_mm,
            shoulder_mm=(200.0, 1120.0),
        )
        return place(somewhere, local_mm, reach, rng)
    rotation = np.eye(3)
    for axis, degrees in enumerate(visit.rotation_deg):
        rotation = rotate_about(np.radians(degrees) * np.eye(3)[axis]) @ rotation
    placement = Placement(visit.placement, rotation, np.array(visit.position_mm))
    return placement, reach.articulations(placement.to_base(local_mm), visit.rounds)

"""Interim checks of one arm over weeks: a few minutes a day, and the faults that occur meanwhile.

A `Happening` is a fault from a day on: a plant of any cause, sudden or by wear. A check itself may
be bad too (a grain of dirt in a seat, the wrong artefact). Each day's arm is rebuilt with the day's
share of every plant, by the same physics as everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import Literal

import numpy as np

from armd.arrays import F64
from armd.errors import BadInput
from armd.simulator.measured.artefact import Artefact, Length
from armd.simulator.measured.campaign import Campaign, Rig
from armd.simulator.measured.measuring import Measured, find_reach, take_readings
from armd.simulator.measured.noise import Noise
from armd.simulator.measured.placement import Placement, place
from armd.simulator.measured.plan import MOUNTED, Climate, SessionPlan, Visit
from armd.simulator.measured.poses import Reach, Unreachable
from armd.simulator.plants.causes import plant_all
from armd.simulator.plants.plant import Plant, parse_plant
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.nominal import SELF_HEATING_W
from armd.simulator.truth.rotations import draw_directions, rotate_about

#: Hours from the mounting of the arm to the first check; it has been calibrated by then.
FIRST_H = 75.0
#: The artefacts of a check, with the number of readings of each target.
ARTEFACTS: dict[str, tuple[Callable[[np.random.Generator], Artefact], int]] = {}
Bad = Literal["dirty-seat", "wrong-artefact"]
BAD: tuple[Bad, ...] = ("dirty-seat", "wrong-artefact")
MOST_TRIES = 100
#: Displacement by a grain of dirt, and length error of a wrong bar, mm.
GRAIN_MM, OTHER_MM = 0.04, 0.15
#: Details of a plant that may be sudden or lasting: it lasts from its day on.
LASTING: dict[str, float | str] = {"instant_s": -np.inf, "kind": "once"}
MOUNT: dict[str, float | str] = {"instant_s": -np.inf, "kind": "step"}


@dataclass(frozen=True)
class Happening:
    """A plant from a day on: the check of this day is the first one with it.

    One that grows does so with use, and reaches its size on the last day.
    """

    plant: Plant
    day: float
    grows: bool = False


@dataclass(frozen=True)
class CheckSeries:
    """Checks of *days* days, the faults of the arm, and the bad checks."""

    days: int
    happenings: tuple[Happening, ...] = ()
    bad: tuple[tuple[Bad, int], ...] = ()
    artefact: str = "bar"


def parse_happening(text: str, default_day: float) -> Happening:
    """Parse `cause@location=size@day`; a `+` behind the day: it grows with use from then on."""
    head, at_sign, day = text.rpartition("@")
    if not at_sign or "=" not in head:
        return Happening(parse_plant(text), default_day)
    grows, digits = day.endswith("+"), day.removesuffix("+")
    try:
        return Happening(parse_plant(head), float(digits) if digits else default_day, grows)
    except ValueError:
        raise BadInput("--plant", text, f"day {day!r}", "a number of days, as in =15@12") from None


def parse_bad(text: str) -> tuple[Bad, int]:
    """Parse `dirty-seat@17`: a kind of bad check, and its day."""
    kind, _, day = text.partition("@")
    for bad_kind in BAD:
        if kind == bad_kind and day.isdecimal():
            return bad_kind, int(day)
    raise BadInput("--bad", text, "this text", f"KIND@DAY, KIND one of {', '.join(BAD)}")


def find_instant(day: float) -> datetime:
    """Return when a day's check may begin: after that day's happening."""
    return MOUNTED + timedelta(hours=FIRST_H + 24.0 * (day - 1))


def use(days: int, seed: int) -> F64:
    """Draw the share of its use (0 … 1) that the arm has had until each day: (days + 1,).

    It rests at weekends, and some days are long.
    """
    rng = np.random.default_rng([seed, 0x05E])
    hours = np.exp(rng.normal(0.0, 0.5, days)) * np.where(np.arange(days) % 7 < 5, 1.0, 0.0)
    total = np.concatenate([[0.0], np.cumsum(hours)])
    share: F64 = total / max(float(total[-1]), 1e-12)
    return share


def compute_share(happening: Happening, day: float, used: F64) -> float:
    """Return the share of a happening that is present at *day*."""
    if day < happening.day:
        return 0.0
    if not happening.grows:
        return 1.0
    days = np.arange(len(used))
    at_onset, now = np.interp([happening.day, day], days, used)
    return float((now - at_onset) / max(1.0 - at_onset, 1e-12))


def make_seats(rng: np.random.Generator) -> Artefact:
    """Make three seats on a plate, at unknown positions."""
    seats_mm = np.array([[0.0, 0.0, 0.0], [180.0, 0.0, 40.0], [60.0, 160.0, 90.0]])
    seats_mm = seats_mm + rng.normal(0.0, 0.3, (3, 3))
    return Artefact("seats", ["S1", "S2", "S3"], np.full((3, 3), np.nan), seats_mm, 0.0, 0.0, 0.0)


def make_sphere(rng: np.random.Generator) -> Artefact:
    """Make a sphere on a stand, its centre unknown."""
    return Artefact("sphere", ["S1"], np.full((1, 3), np.nan), np.zeros((1, 3)), 0.0, 0.0, 0.0)


def make_bar(rng: np.random.Generator) -> Artefact:
    """Make two balls 500 mm apart on carbon, their distance certified to 0.5 µm."""
    true = np.array([[0.0, 0.0, 0.0], [500.0 + rng.normal(0.0, 0.05), 0.0, 0.0]])
    certified = float(np.round(true[1, 0] + rng.normal(0.0, 5e-4), 5))
    unknown = np.full((2, 3), np.nan)
    artefact = Artefact("ball bar", ["B1", "B2"], unknown, true, 0.0, 0.5e-6, 0.5e-6)
    return replace(artefact, lengths=[Length(("B1", "B2"), certified, 5e-4)])


ARTEFACTS |= {"seats": (make_seats, 7), "sphere": (make_sphere, 15), "bar": (make_bar, 10)}


def plan_interim(seed: int, noise: Noise, artefact: str = "bar") -> Campaign:
    """Make the campaign of the first day, without sessions; `measure_checks` measures it."""
    rig_artefact = ARTEFACTS[artefact][0](np.random.default_rng([seed, 0x1A7]))
    return Campaign(nominal.make_arm_toml(), Rig(TrueArm.default(seed), rig_artefact, noise), [])


def find_first_day(happening: Happening, used: F64) -> float:
    """Return the first day with an effect: wear begins when the arm is used, not at rest."""
    if not happening.grows:
        return happening.day
    days = np.arange(len(used))
    at_onset = float(np.interp(happening.day, days, used))
    after = np.flatnonzero((days > happening.day) & (used > at_onset))
    return happening.day if not len(after) else max(happening.day, float(after[0] - 1))


def plant_happenings(
    begun: Campaign,
    happenings: Sequence[Happening],
    day: float,
    used: F64,
    drawn: int,
    plan: SessionPlan,
) -> Campaign:
    """Return the campaign *begun* with all happenings until a day.

    *drawn*: the seed of their random properties.
    """
    today = begun
    for number, happening in enumerate(happenings):
        size = compute_share(happening, day, used)
        today = _planted(today, happening.plant, size, [drawn, 0x9147, number], plan)
    return today


def measure_checks(
    history: CheckSeries, seed: int, noise: Noise, drawn: int | None = None
) -> Iterator[Measured]:
    """Measure check after check with the arm of *seed*.

    *drawn*: the seed of everything else, if it is another one.
    """
    for happening in history.happenings:
        if not 0 <= happening.day <= history.days:
            expected = f"0 to {history.days}, the days of the history"
            raise BadInput("--plant", happening.plant.cause, f"day {happening.day:g}", expected)
    for kind, day in history.bad:
        if not 1 <= day <= history.days:
            raise BadInput("--bad", kind, f"day {day}", f"1 to {history.days}")
    luck = seed if drawn is None else drawn
    rng = np.random.default_rng([luck, 0x17E2])
    begun = plan_interim(seed, noise, history.artefact)
    artefact, count = begun.rig.artefact, ARTEFACTS[history.artefact][1]
    reach = find_reach(begun.rig, rng)
    used = use(history.days, luck)
    visit = Visit("P1", (), count, radius_mm=(200.0, 750.0))
    stand, _ = place(visit, artefact.true_mm, reach, rng)
    for day in range(1, history.days + 1):
        start_h = FIRST_H + 24.0 * (day - 1) + float(rng.uniform(0.0, 0.5))
        power = SELF_HEATING_W * rng.uniform(0.7, 1.3, len(SELF_HEATING_W))
        climate = Climate(20.0 + float(rng.normal(0.0, 1.5)), power_w=power)
        plan = SessionPlan(f"day-{day:02}", start_h, climate, (visit,), interval_s=6.0)
        rig = plant_happenings(begun, history.happenings, float(day), used, luck, plan).rig
        for kind, its_day in history.bad:
            if its_day == day:
                rig = _spoilt(rig, kind, np.random.default_rng([luck, 0xBAD, day]))
        pose, poses = _poses(stand, artefact, count, reach, rng)
        order = rng.permutation(len(artefact.targets) * count)
        target = np.repeat(np.arange(len(artefact.targets)), count)[order]
        phi = poses.reshape(len(order), -1)[order]
        yield take_readings(
            rig, plan, [pose], np.zeros(len(order), dtype=np.int64), target, phi, rng
        )


def _planted(
    today: Campaign, plant: Plant, size: float, seed: list[int], plan: SessionPlan
) -> Campaign:
    """Plant today's share of a plant, with the same random properties every day."""
    if size == 0.0:
        return today
    lasting = MOUNT if plant.cause == "mount_drift" else LASTING
    if plant.cause not in ("mount_drift", "tip_offset", "encoder_slip"):
        lasting = {}
    now = replace(plant, size=size * plant.size, detail={**lasting, **plant.detail})
    single_session = replace(today, sessions=[(plan, today.rig.artefact)])
    return replace(plant_all(single_session, [now], np.random.default_rng(seed)), sessions=[])


def _spoilt(rig: Rig, kind: Bad, rng: np.random.Generator) -> Rig:
    artefact = rig.artefact
    if kind == "wrong-artefact":
        scaled_mm = artefact.true_mm * (1.0 + OTHER_MM / max(np.ptp(artefact.true_mm), 1.0))
        return replace(rig, artefact=replace(artefact, true_mm=scaled_mm))
    grain = GRAIN_MM * draw_directions(rng, 1)[0]
    begins = rng.uniform(0.2, 0.5)

    def spoil(later: np.random.Generator, n: int) -> F64:
        """Displace the ball from some reading on, whenever it presses on the grain."""
        under = (np.arange(n) >= begins * n) & (later.uniform(size=n) < 0.6)
        return np.where(under[:, None], grain, 0.0)

    return replace(rig, spoil=spoil)


def _poses(
    stand: Placement, artefact: Artefact, count: int, reach: Reach, rng: np.random.Generator
) -> tuple[Placement, F64]:
    """Return today's placement of the artefact, and postures at its targets (K, count, N)."""
    for _ in range(MOST_TRIES):
        pose = _put_again(stand, rng)
        try:
            return pose, reach.articulations(pose.to_base(artefact.true_mm), count)
        except Unreachable:
            continue
    raise Unreachable(f"the {artefact.name} stands where the arm hardly reaches it")


def _put_again(stand: Placement, rng: np.random.Generator) -> Placement:
    """Return the placement when a hand puts the artefact on its mark again."""
    turn = rotate_about(np.array([0.0, 0.0, rng.normal(0.0, np.radians(1.0))]))
    return replace(
        stand, rotation=turn @ stand.rotation, origin_mm=stand.origin_mm + rng.normal(0.0, 2.0, 3)
    )

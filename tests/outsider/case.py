"""One case: an arm, what was measured with it, and what was wrong. Kind and seed say all of it."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from outsider.around import AROUND
from outsider.chain import F64, Alteration, by_angles, posture
from outsider.faults import FAULTS, UNDER_A_CALIBRATION
from outsider.habits import HABITS, Habit
from outsider.measured import (
    KEPT_C,
    KEPT_RESTLESS,
    Machine,
    Plan,
    Readings,
    Rng,
    Thing,
    draw_machine,
    draw_thing,
    measure,
    repeated,
)
from outsider.scene import Fault, Scene
from outsider.seen import Seen

#: Nothing wrong with the arm; with the readings, something: every other case has a disc besides.
TAKEN = ("t3", "gross", "dead", "doubled", "floor", "unread", "coarse", "narrow", "uneven",
         "repeats")  # fmt: skip
MESSES = (*TAKEN, *HABITS)
#: A mess and a fault that is no disc.
BOTH = {"dead_relax": ("dead", "relax"), "gross_play": ("gross", "play"),
        "wall": ("wall", "sag"), "bare": ("bare", "sag")}  # fmt: skip
#: Wrong with the arm long before the calibration under test, and plainly so.
OLDER = {"old_disc": "disc", "old_sag": "sag"}
EVERY = FAULTS | AROUND
KINDS = ("clean", *EVERY, *MESSES, *BOTH, *OLDER)
#: Noise units, clear of all that absorbs.
WANTED, PLAINLY = (8.0, 25.0), (40.0, 200.0)
#: A rival that leaves less of a fault than this is the same to any reader of these readings.
TOLD_APART = 3.0
#: How much more a point scatters while a machine next door shakes the floor; what steel grows.
SHAKEN, STEEL_PER_K = 5.0, 11.5e-6
#: Encoders that count in steps, rad; what a tracker scatters by, mm, and mm more per mm away.
STEPS_RAD, TRACKED_MM, TRACKED_PER_MM = (5e-5, 1e-4), 5e-3, 2e-6
#: How often each rest is read by who repeats readings without letting go.
TIMES = 4


@dataclass(frozen=True)
class Truth:
    """What the judge may know."""

    kind: str
    seed: int
    cause: str  # "": none
    location: str
    depends_on: tuple[str, ...]
    beside: tuple[tuple[str, str], ...]
    same_signal: tuple[tuple[str, str], ...]
    needs: str
    noise_units: float
    words: str
    placement: str  # of a touched artefact, with its session
    held: bool  # under a calibration from before
    noise_um: float  # 3-D RMS of the noise alone, on the further session
    mess_names: tuple[tuple[str, str], ...] = ()  # true of the mess: told or not, they do not count
    mess_depends_on: tuple[str, ...] = ()  # nor does `unknown` in nothing but these
    mistaken: str = ""  # of targets counted from another end, with its session: may be refused


@dataclass(frozen=True)
class Case:
    truth: Truth
    machine: Machine
    thing: Thing
    plan: Plan
    readings: Readings
    seat_mm: F64  # (n,) scatter of a point, along each axis
    alter: Alteration
    rng: Rng  # for noise and mess
    mess: str = ""
    step_rad: float = 0.0  # of what an encoder shows; 0: as fine as a float
    tracked_mm: F64 | None = None  # (n, 3) what a tracker said


def draw(kind: str, seed: int) -> Case:
    """The case of a kind, one of KINDS, and a seed."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    messy = kind in MESSES or kind == "clean"
    held = kind in (*UNDER_A_CALIBRATION, *OLDER, "another", "shop_floor") or bool(
        (seed // 2 if messy else seed) % 2
    )
    mess, planted = BOTH.get(kind, (kind, OLDER.get(kind, kind)))
    if kind in MESSES and (seed % 2 or kind == "hand"):
        planted = "disc"
    machine, thing = draw_machine(rng), _thing(rng, kind)
    fine_rad, step_rad = machine.encoder_rad, 0.0
    if kind == "coarse":
        step_rad = float(rng.uniform(*STEPS_RAD))
        machine = replace(machine, encoder_rad=float(np.hypot(fine_rad, step_rad / np.sqrt(12))))
    plan = _plan(rng, kind, held)
    readings = measure(rng, machine, thing, plan)
    if kind == "repeats":
        readings = repeated(readings, TIMES)
    down = tuple(rng.permutation([1.0, 0.0])) if kind == "wall" else (0.0, 0.0)
    on = (readings.session >= plan.before) | (kind in OLDER)
    scene = Scene(machine, readings, on, thing, (*down, 0.0 if kind == "wall" else -1.0))
    known = readings.session < plan.sessions - 1
    seat_mm = np.full(len(readings.q), machine.seat_mm)
    if kind == "floor":
        seat_mm[readings.session == rng.integers(plan.before, plan.sessions - 1)] *= SHAKEN
    habit = Habit(scene.none(), "", (("outliers", "rows"),) if mess in ("gross", "t3") else ())
    if kind in HABITS:
        habit = HABITS[kind](rng, scene)
    if habit.truth_mm is not None:
        seat_mm = TRACKED_MM + TRACKED_PER_MM * np.linalg.norm(habit.truth_mm, axis=1)
    # of readings that share their seat, those of a rest say no more than one
    seen = Seen(
        machine,
        readings.only(known),
        seat_mm[known] * (np.sqrt(TIMES) if kind == "repeats" else 1.0),
    )
    fault = Fault("", "", (), scene.none(), "")
    if planted in EVERY:
        wanted = float(np.exp(rng.uniform(*np.log(PLAINLY if kind in OLDER else WANTED))))
        fault = _sized(EVERY[planted](rng, scene), seen, known, wanted)
        fault = _with_its_like(fault, seen, scene, known)
    spread = _noise_mm(machine, readings.only(~known), seat_mm[~known])
    truth = Truth(
        kind, seed, fault.cause, fault.location, fault.depends_on, fault.beside,
        fault.same_signal, fault.needs, seen.noise_units(_rows(fault.alter, known)),
        ", ".join(filter(None, (fault.words, habit.words))),
        _touched(fault, plan, readings) if fault.cause == "artefact_moved" else "", held,
        1e3 * float(np.sqrt((spread**2).mean())), habit.names, habit.variables,
        "" if habit.mistaken is None else _placement(habit.mistaken, plan, readings),
    )  # fmt: skip
    return Case(
        truth, replace(machine, encoder_rad=fine_rad), thing, plan, readings, seat_mm,
        fault.alter.plus(habit.alter), rng, mess, step_rad, habit.truth_mm,
    )  # fmt: skip


def _thing(rng: Rng, kind: str) -> Thing:
    """What is measured: an artefact, or points under a tracker."""
    thing = draw_thing(rng)
    if kind == "tracker":
        return Thing("a tracker's reflector", rng.uniform(0, 500, (60, 3)), 0.0)
    while kind == "numbered" and thing.name == "tower of cones":
        thing = draw_thing(rng)
    if kind == "numbered" and thing.name == "ball beam":  # evenly spaced, it is the same backwards
        along = np.outer(rng.normal(0, 0.5, len(thing.points)), [1.0, 0.0, 0.0])
        return replace(thing, points=thing.points + along)
    return replace(thing, per_k=STEEL_PER_K) if kind in ("unread", "unsoaked") else thing


def _plan(rng: Rng, kind: str, held: bool) -> Plan:
    sessions = int(rng.integers(4, 9))
    rows = int(rng.integers(240, 481)) // sessions * (TIMES if kind == "repeats" else 1)
    restless = 4.0 if kind == "lag" else 1.0  # slower drifts show no lag
    plan = Plan(4 if held else 0, sessions, rows, 2 if rows < 60 else 3, restless)
    if kind == "narrow":
        return replace(plan, restless=KEPT_RESTLESS, climates_c=(*KEPT_C, 20.5, 21.0))
    if kind == "shop_floor":
        return replace(plan, kept_before=True)
    return replace(plan, uneven=True, placements=3) if kind == "uneven" else plan


def _sized(variants: list[Fault], seen: Seen, known: F64, wanted: float) -> Fault:
    """The variant nearest to the noise units wanted; one whose size is free is brought there, the
    first that is then no larger than a real one, or the least too large."""
    found = []
    for one in variants:
        units, excess = seen.noise_units(_rows(one.alter, known)), 1.0
        if one.free and units > 0:
            small = one.alter.times(1e-6)  # where everything is linear
            size = 1e-6 * wanted / seen.noise_units(_rows(small, known))
            one = replace(one, alter=one.alter.times(size), words=f"{one.words} × {size:.3g}")
            units, excess = wanted, max(size / one.largest, 1.0)
        found.append((abs(np.log(max(units, 1e-9) / wanted)), excess, one))
    return min(found, key=lambda each: each[:2])[2]


def _with_its_like(fault: Fault, seen: Seen, scene: Scene, known: F64) -> Fault:
    """With the rivals that leave next to nothing of it as names of the same signal."""
    alter = _rows(fault.alter, known)
    left = {
        (cause, fault.location): seen.noise_units(alter, [_rows(one, known) for one in shapes])
        for cause, shapes in fault.rivals
    }
    if fault.cause == "sensor_offset":  # beside a sensor that hardly matters, an exchange mends it
        for one, other in combinations(range(scene.machine.joints), 2):
            mended = _rows(read_exchanged(scene, fault.alter, one, other), known)
            name = ("sensor_swapped", f"sensors t{one + 1}, t{other + 1}")
            left[name] = seen.noise_units(mended)
    like = tuple(name for name, units in left.items() if units < TOLD_APART)
    words = [fault.words, *(f"{' '.join(name)} leaves {left[name]:.1f}" for name in like)]
    return replace(
        fault, words=", ".join(words), same_signal=(*fault.same_signal, *like)
    )  # fmt: skip


def read_exchanged(scene: Scene, alter: Alteration, one: int, other: int) -> Alteration:
    """What is left wrong if somebody takes two sensors, from 0, as altered, for exchanged."""
    sensor, shown = alter.sensor.copy(), scene.readings.warm + alter.sensor
    for own, from_ in ((one, other), (other, one)):
        sensor[scene.on, own] = (shown[:, from_] - scene.readings.warm[:, own])[scene.on]
    return replace(alter, sensor=sensor)


def _rows(alter: Alteration, rows: F64) -> Alteration:
    return Alteration(*(part[rows] for part in vars(alter).values()))


def _noise_mm(machine: Machine, readings: Readings, seat_mm: F64) -> F64:
    """(n,) the 3-D standard deviation of each reading."""
    jacobian = by_angles(posture(machine.built, readings.q, readings.warm))
    variance = machine.encoder_rad**2 * (jacobian**2).sum(axis=(1, 2)) + 3 * seat_mm**2
    spread: F64 = np.sqrt(variance)
    return spread


def session_name(plan: Plan, session: int) -> str:
    if session < plan.before:
        return f"before-{session + 1}"
    number = session - plan.before + 1
    return f"session-{number}" if number <= plan.diagnosed else "further"


def _touched(fault: Fault, plan: Plan, readings: Readings) -> str:
    row = int(np.flatnonzero(fault.alter.target.any(axis=1))[0])
    return _placement(int(readings.placement[row]), plan, readings)


def _placement(placement: int, plan: Plan, readings: Readings) -> str:
    row = int(np.flatnonzero(readings.placement == placement)[0])
    name = session_name(plan, int(readings.session[row]))
    return f"{name} P{placement % plan.placements + 1}"

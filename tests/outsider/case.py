"""One case: an arm, what was measured with it, and what was wrong. Kind and seed say all of it."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from outsider.chain import F64, Alteration, by_angles, posture
from outsider.crowds import CROWDS, KNOWN, One
from outsider.faults import UNDER_A_CALIBRATION
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
from outsider.sizes import rows_of, sized, with_its_like

#: Nothing wrong with the arm; with the readings, something: every other case has a disc besides.
TAKEN = ("t3", "gross", "dead", "doubled", "floor", "unread", "coarse", "narrow", "uneven",
         "repeats")  # fmt: skip
MESSES = (*TAKEN, *HABITS)
#: A mess and a fault that is no disc.
BOTH = {"dead_relax": ("dead", "relax"), "gross_play": ("gross", "play"),
        "wall": ("wall", "sag"), "bare": ("bare", "sag")}  # fmt: skip
#: Wrong with the arm long before the calibration under test, and plainly so.
OLDER = {"old_disc": "disc", "old_sag": "sag"}
KINDS = ("clean", *KNOWN, *MESSES, *BOTH, *OLDER, *CROWDS)
#: Noise units, clear of all that absorbs.
WANTED, PLAINLY = (8.0, 25.0), (40.0, 200.0)
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
    #: Of a crowd, every fault of it; its `noise_units` are then clear of what the others leave free
    each: tuple[Truth, ...] = ()
    plain_units: float = 0.0  # of one in a crowd: clear of the others as they are, of any size


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
    if planted in KNOWN:
        wanted = float(np.exp(rng.uniform(*np.log(PLAINLY if kind in OLDER else WANTED))))
        fault = sized(KNOWN[planted](rng, scene), seen, known, wanted)
        fault = with_its_like(fault, seen, scene, known)
    them = CROWDS[kind](rng, scene, seen, known) if kind in CROWDS else []
    alter = reduce(Alteration.plus, (one.fault.alter for one in them), fault.alter)
    spread = _noise_mm(machine, readings.only(~known), seat_mm[~known])
    truth = Truth(
        kind, seed, fault.cause, fault.location, fault.depends_on, fault.beside,
        fault.same_signal, fault.needs, seen.noise_units(rows_of(alter, known)),
        ", ".join(filter(None, (fault.words, habit.words))),
        _touched(fault, plan, readings), held,
        1e3 * float(np.sqrt((spread**2).mean())), habit.names, habit.variables,
        "" if habit.mistaken is None else _placement(habit.mistaken, plan, readings),
    )  # fmt: skip
    truth = replace(truth, each=tuple(_of_a_crowd(truth, one, plan, readings) for one in them))
    return Case(
        truth, replace(machine, encoder_rad=fine_rad), thing, plan, readings, seat_mm,
        alter.plus(habit.alter), rng, mess, step_rad, habit.truth_mm,
    )  # fmt: skip


def _of_a_crowd(truth: Truth, one: One, plan: Plan, readings: Readings) -> Truth:
    fault = one.fault
    return replace(
        truth, cause=fault.cause, location=fault.location, depends_on=fault.depends_on,
        beside=fault.beside, same_signal=fault.same_signal, needs=fault.needs,
        noise_units=one.clear_units, plain_units=one.plain_units, words=fault.words,
        placement=_touched(fault, plan, readings),
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
    # slower drifts show no lag
    restless = 4.0 if kind == "lag" or (kind == "crowd" and rng.random() < 0.5) else 1.0
    plan = Plan(4 if held else 0, sessions, rows, 2 if rows < 60 else 3, restless)
    if kind == "narrow":
        return replace(plan, restless=KEPT_RESTLESS, climates_c=(*KEPT_C, 20.5, 21.0))
    if kind == "shop_floor":
        return replace(plan, kept_before=True)
    return replace(plan, uneven=True, placements=3) if kind == "uneven" else plan


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
    if fault.cause != "artefact_moved":
        return ""
    row = int(np.flatnonzero(fault.alter.target.any(axis=1))[0])
    return _placement(int(readings.placement[row]), plan, readings)


def _placement(placement: int, plan: Plan, readings: Readings) -> str:
    row = int(np.flatnonzero(readings.placement == placement)[0])
    name = session_name(plan, int(readings.session[row]))
    return f"{name} P{placement % plan.placements + 1}"

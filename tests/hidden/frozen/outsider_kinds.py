"""The kinds drawn by the generator that shares nothing with armd (tests/outsider)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

import numpy as np
from hidden.frozen.case import Cause, Truth, rounded, write_truth
from hidden.frozen.oracle import BEFORE, DIAGNOSED, F64, FURTHER, Problem
from outsider import case as outside
from outsider.angles import warmed
from outsider.case import Case
from outsider.chain import Alteration, by_angles, by_constants, posture
from outsider.crowds import CROWDS, KNOWN
from outsider.faults import lag
from outsider.files import write
from outsider.measured import Plan, draw_machine, draw_thing, measure
from outsider.scene import Fault, Scene
from outsider.seen import Seen

Rng = np.random.Generator
#: Temperatures of the sessions from before, by how many there are.
CALIBRATED_AT = {
    1: (20.0, 20.0, 20.0, 20.0), 2: (16.0, 24.0, 16.0, 24.0), 4: (14.0, 18.0, 22.0, 26.0),
}  # fmt: skip
LEVELS = (15.0, 18.0, 21.0, 24.0, 27.0)
THERMAL = ("one", "all", "warmed", "second", "lag", "bow", "clean")
#: Noise units wanted of a thermal cause, clear of all that absorbs it.
WANTED = (10.0, 30.0)
ROWS = 84  # in each session of a thermal case
#: Beginnings of kinds whose calibration may have no thermal model: it was made at one temperature,
#: or what was wrong already hid how the links grow.
WITHOUT_THERMAL_MODEL = ("narrow", "old_")


@dataclass(frozen=True)
class Drawn:
    case: Case
    effects: tuple[Alteration, ...]  # of each cause, in the truth's order


def of_kind(kinds: tuple[str, ...]) -> Callable[[Rng, int], Drawn]:
    """The generator's own kinds, one after another."""

    def draw(rng: Rng, number: int) -> Drawn:
        # its even and odd seeds mean different things
        seed = 2 * int(rng.integers(1 << 28)) + (number // len(kinds)) % 2
        return Drawn(outside.draw(kinds[number % len(kinds)], seed), ())

    return draw


def of_joints(rng: Rng, number: int) -> Drawn:
    """Arms of 3 to 9 joints with one fault each."""
    joints = 3 + number % 7
    kinds = ("disc", "play", "slip", "sag", "wave", "gain", "disc")
    kind = kinds[int(rng.integers(len(kinds)))] if joints > 3 else "disc"
    machine, thing = draw_machine(rng, joints), draw_thing(rng)
    if joints < 5:  # whose tip reaches a place in one way or two
        drawn, built = machine.drawn, machine.built
        longer = np.array([0.0, 250.0, *np.zeros(joints - 2)])
        machine = replace(
            machine, limit=np.full(joints, 3.1), drawn=replace(drawn, a=drawn.a + longer),
            built=replace(built, a=built.a + longer),
        )  # fmt: skip
        thing = replace(thing, points=0.2 * thing.points)
    plan = Plan(4 if number % 2 else 0, 4, 72, 3)
    return _drawn(rng, "joints", machine, thing, plan, [kind], f"{joints} joints")


def thermal(temperatures: int) -> Callable[[Rng, int], Drawn]:
    """A calibration made at so many temperatures, and each thermal cause."""

    def draw(rng: Rng, number: int) -> Drawn:
        what, in_order = THERMAL[number % len(THERMAL)], (number // len(THERMAL)) % 2 == 0
        machine, thing = draw_machine(rng, 6), draw_thing(rng)
        if temperatures == 1 and what != "lag":  # a carbon arm: nothing grows but what is planted
            still = np.zeros_like(machine.built.per_k)
            machine = replace(machine, built=replace(machine.built, per_k=still))
        levels = np.array(LEVELS if rng.random() < 0.5 else LEVELS[::-1])
        if not in_order:
            levels = rng.permutation(levels)
        further = float(rng.choice([16.0, 26.0]))
        plan = Plan(
            4, len(LEVELS), ROWS, 3, restless=4.0 if what == "lag" else 1.0,
            kept_before=temperatures == 1,
            levels_c=(*CALIBRATED_AT[temperatures], *map(float, levels), further),
        )  # fmt: skip
        order = "in order" if in_order else "out of order"
        words = f"{temperatures} temperatures, {order}"
        return _drawn(rng, "thermal", machine, thing, plan, [] if what == "clean" else [what],
                      words, growing=temperatures == 1 and what == "lag")  # fmt: skip

    return draw


def _drawn(
    rng: Rng, kind: str, machine: outside.Machine, thing: outside.Thing, plan: Plan,
    faults: list[str], words: str, growing: bool = False,
) -> Drawn:  # fmt: skip
    readings = measure(rng, machine, thing, plan)
    scene = Scene(machine, readings, readings.session >= plan.before, thing)
    flat = np.full(len(readings.q), machine.seat_mm)
    planted: list[Fault] = []
    for name in faults:
        draw = THERMAL_FAULTS.get(name) or KNOWN[name]
        variants = draw(rng, scene)
        fault = variants[int(rng.integers(len(variants)))]
        if fault.free:
            wanted = float(np.exp(rng.uniform(*np.log(WANTED))))
            problem = _problem(machine, readings, plan, flat, [fault.alter.times(1e-6)],
                               growing=name in ("one", "all"))  # fmt: skip
            size = 1e-6 * wanted / problem.noise_units()[0]
            sized = f"{fault.words} × {size:.3g}".strip()
            fault = replace(fault, alter=fault.alter.times(size), words=sized)
        planted.append(fault)
    alters = [fault.alter for fault in planted]
    if growing:
        planted.append(_growth_of_all(scene))
    spread = np.sqrt((_noise(machine, readings) ** 2)[readings.session == plan.sessions - 1].mean())
    head = planted[0] if planted else Fault("", "", (), scene.none(), "")
    truth = outside.Truth(
        kind, 0, head.cause, head.location, head.depends_on, head.beside, head.same_signal,
        head.needs, 0.0, f"{words}: {', '.join(_told(f) for f in planted) or 'nothing planted'}",
        "", plan.before > 0, 1e3 * float(spread),
    )  # fmt: skip
    each = tuple(
        replace(truth, cause=f.cause, location=f.location, depends_on=f.depends_on,
                beside=f.beside, same_signal=f.same_signal, needs=f.needs)
        for f in planted
    )  # fmt: skip
    truth = replace(truth, each=each)
    alter = reduce(Alteration.plus, alters, scene.none())
    flat = np.full(len(readings.q), machine.seat_mm)
    found = Case(truth, machine, thing, plan, readings, flat, alter, rng)
    return Drawn(found, tuple(fault.alter for fault in planted))


def _told(fault: Fault) -> str:
    return f"{fault.cause} {fault.location} {fault.words}".strip()


def _noise(machine: outside.Machine, readings: outside.Readings) -> F64:
    """(n,) the 3-D standard deviation of each reading."""
    jacobian = by_angles(posture(machine.built, readings.q, readings.warm))
    variance = machine.encoder_rad**2 * (jacobian**2).sum(axis=(1, 2)) + 3 * machine.seat_mm**2
    spread: F64 = np.sqrt(variance)
    return spread


def _strained(scene: Scene, strains: dict[int, F64]) -> Alteration:
    """Links (from 0) longer by strains (n,)."""
    shift = np.zeros((*scene.readings.q.shape, 3))
    for k, strain in strains.items():
        shift[:, k] = (strain * scene.on)[:, None] * scene.machine.along(k)
    return replace(scene.none(), shift=shift)


def _long(scene: Scene) -> list[int]:
    machine = scene.machine
    return [k for k in range(1, machine.joints - 1) if np.linalg.norm(machine.along(k)) > 100]


def one(rng: Rng, scene: Scene) -> list[Fault]:
    k = int(rng.choice(_long(scene)))
    alter = _strained(scene, {k: rng.choice([1.0, 1.0, -1.0]) * scene.readings.warm[:, k]})
    return [Fault("link_expansion", f"link {k + 1}", (f"t{k + 1}",), alter, "")]


def every(rng: Rng, scene: Scene) -> list[Fault]:
    joints = range(scene.machine.joints)
    shares = rng.uniform(0.4, 1.0, scene.machine.joints)
    alter = _strained(scene, {k: shares[k] * scene.readings.warm[:, k] for k in joints})
    return [_of_links(scene, alter, list(joints), "all links")]


def _of_links(scene: Scene, alter: Alteration, links: list[int], words: str) -> Fault:
    longest = max(links, key=lambda k: float(np.linalg.norm(scene.machine.along(k))))
    names = tuple(("link_expansion", f"link {k + 1}") for k in links)
    variables = tuple(f"t{k + 1}" for k in links)
    return Fault(
        "link_expansion", f"link {longest + 1}", variables, alter, words, beside=names
    )  # fmt: skip


def _growth_of_all(scene: Scene) -> Fault:
    """What a calibration of one temperature misses of an arm that grows."""
    per_k, joints = scene.machine.built.per_k[:, 0], range(scene.machine.joints)
    alter = _strained(scene, {k: per_k[k] * scene.readings.warm[:, k] for k in joints})
    return _of_links(scene, alter, list(joints), "all links")


def second(rng: Rng, scene: Scene) -> list[Fault]:
    """A link whose coefficient rises above 20 °C, within 2.5 K."""
    k = int(rng.choice(_long(scene)))
    warm, wide = scene.readings.warm[:, k], 2.5
    strain = wide * (np.log1p(np.exp(warm / wide)) - np.log(2.0))
    alter = _strained(scene, {k: strain})
    # half of it is a straight line in temperature
    return [
        Fault("nonlinear_expansion", f"link {k + 1}", (f"t{k + 1}",), alter, "rises above 20 °C",
              same_signal=(("link_expansion", f"link {k + 1}"),))
    ]  # fmt: skip


def bow(rng: Rng, scene: Scene) -> list[Fault]:
    """A link bends with the difference between its sensor and its neighbour's."""
    machine, k = scene.machine, int(rng.choice(_long(scene)))
    warm = scene.readings.warm
    by = (warm[:, k] - warm[:, k - 1]) * scene.on
    span = machine.along(k)
    length = float(np.linalg.norm(span))
    side = np.cross(span, rng.standard_normal(3))
    side /= np.linalg.norm(side)
    turn, shift = np.zeros((len(by), machine.joints, 3)), np.zeros((len(by), machine.joints, 3))
    turn[:, k] = by[:, None] * side
    shift[:, k] = by[:, None] * np.cross(side, span / length) * length / 2
    place, variables = f"link {k + 1}", (f"t{k + 1}", f"t{k}")
    return [Fault("thermal_gradient", place, variables,
                  replace(scene.none(), turn=turn, shift=shift), "")]  # fmt: skip


THERMAL_FAULTS: dict[str, Callable[[Rng, Scene], list[Fault]]] = {
    "one": one, "all": every, "second": second, "bow": bow, "warmed": warmed, "lag": lag,
}  # fmt: skip


def write_case(folder: Path, kind: str, seed: int, drawn: Drawn) -> Truth:
    """Write a whole case; return its truth, which is written too."""
    case = drawn.case
    write(case, folder)
    (folder / "truth.json").unlink()
    (folder / "further").rename(folder / "further-1")
    told = case.truth
    each = told.each or ((told,) if told.cause else ())
    problem = _problem_of(drawn)
    units = problem.noise_units() if drawn.effects else [one.noise_units for one in each]
    causes = tuple(
        Cause(one.cause, one.location, rounded(value), one.beside, one.same_signal,
              one.depends_on, one.needs, one.placement)
        for one, value in zip(each, units, strict=True)
    )  # fmt: skip
    plain = case.mess in ("", told.kind) and told.kind not in outside.MESSES
    truth = Truth(
        kind, seed, f"{told.kind}: {told.words}", causes, "calibrate" if told.held else "",
        rounded(told.noise_um), rounded(problem.oracle_um()) if plain else None,
        (*told.mess_names, *_list_hidden_growth(case)), told.mess_depends_on,
        refusable=told.mistaken.partition(" ")[0],
    )  # fmt: skip
    write_truth(folder, truth)
    return truth


def _list_hidden_growth(case: Case) -> Iterator[tuple[str, str]]:
    """Yield the names of growth that the arm does have and its calibration may not."""
    if case.truth.held and case.truth.kind.startswith(WITHOUT_THERMAL_MODEL):
        for k in np.flatnonzero(case.machine.built.per_k.any(axis=1)):
            yield "link_expansion", f"link {k + 1}"


def _problem_of(drawn: Drawn) -> Problem:
    case = drawn.case
    growing = bool(drawn.effects) and any(f.cause == "link_expansion" for f in case.truth.each)
    return _problem(case.machine, case.readings, case.plan, case.seat_mm,
                    drawn.effects or (case.alter,), growing)  # fmt: skip


def _problem(
    machine: outside.Machine, readings: outside.Readings, plan: Plan, seat_mm: F64,
    alters: Sequence[Alteration], growing: bool,
) -> Problem:  # fmt: skip
    """On noise of the readings' own size, drawn anew: the files' own is not kept. *growing*: the
    growth of links is what is planted, so it is no constant."""
    seen = Seen(machine, readings, seat_mm)
    effects = [seen.displacement(alter) for alter in alters]
    jacobian = by_angles(posture(machine.built, readings.q, readings.warm))
    rng = np.random.default_rng(int(readings.time_s[-1]))
    angles = machine.encoder_rad * rng.standard_normal(readings.q.shape)
    seats = seat_mm[:, None] * rng.standard_normal((len(readings.q), 3))
    noise = np.einsum("nij,nj->ni", jacobian, angles) + seats
    columns = by_constants(machine.built, readings.q, readings.warm)
    if growing:
        columns = columns[:, :, : -2 * machine.joints]
    part = np.where(readings.session < plan.before, BEFORE, DIAGNOSED)
    part[readings.session == plan.sessions - 1] = FURTHER
    sigma = np.sqrt(machine.encoder_rad**2 * (jacobian**2).sum(axis=(1, 2)) / 3 + seat_mm**2)
    return Problem(
        columns, [effect for effect in effects if np.any(effect)], noise, readings.lever,
        readings.placement.astype(np.int64), part, sigma,
    )  # fmt: skip


SINGLE = tuple(KNOWN)
MESSY = outside.MESSES
KINDS: dict[str, tuple[Callable[[Rng, int], Drawn], int]] = {
    "o-single": (of_kind(SINGLE), 2 * len(SINGLE)), "o-clean": (of_kind(("clean",)), 8),
    "o-messy": (of_kind((*MESSY, *outside.BOTH)), len(MESSY) + len(outside.BOTH)),
    "o-older": (of_kind(tuple(outside.OLDER)), 4), "o-crowd": (of_kind(tuple(CROWDS)), 6),
    "o-repeats": (of_kind(("repeats",)), 4), "o-joints": (of_joints, 7),
    "o-thermal-1": (thermal(1), 14), "o-thermal-2": (thermal(2), 14),
    "o-thermal-4": (thermal(4), 14),
}  # fmt: skip

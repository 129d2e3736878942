"""One case: an arm, what was measured with it, and what was wrong; written as a user's files.

Kind and seed say all of it. The folder gets arm.toml, sessions `before-*` (where a calibration from
before is wanted), `session-*` to diagnose, `further`, which is not diagnosed, and truth.json.
"""

from __future__ import annotations

import csv
import datetime
import json
import zlib
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from outsider.chain import F64, Alteration, by_angles, posture, solve
from outsider.faults import FAULTS, UNDER_A_CALIBRATION, Fault, Scene
from outsider.measured import Machine, Plan, Readings, Rng, Thing, draw_machine, draw_thing, measure
from outsider.seen import Seen

#: Nothing wrong with the arm; with the readings, something: every other case has a disc besides.
MESSES = ("t3", "gross", "dead", "doubled", "floor", "unread")
#: Wrong with the arm long before the calibration under test, and plainly so.
OLDER = {"old_disc": "disc", "old_sag": "sag"}
KINDS = ("clean", *FAULTS, *MESSES, *OLDER)
#: Noise units, clear of all that absorbs.
WANTED, PLAINLY = (8.0, 25.0), (40.0, 200.0)
#: A rival that leaves less of a fault than this is the same to any reader of these readings.
TOLD_APART = 3.0
BEGAN = datetime.datetime(2026, 3, 2, 6, tzinfo=datetime.UTC)
SENSOR_K, GROSS, TWICE = 0.02, 0.03, 0.2
#: How much more a point scatters while a machine next door shakes the floor; what steel grows.
SHAKEN, STEEL_PER_K = 5.0, 11.5e-6


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


def draw(kind: str, seed: int) -> Case:
    """The case of a kind, one of KINDS, and a seed."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    messy = kind in MESSES or kind == "clean"
    held = kind in (*UNDER_A_CALIBRATION, *OLDER) or bool((seed // 2 if messy else seed) % 2)
    machine, thing = draw_machine(rng), draw_thing(rng)
    if kind == "unread":
        thing = replace(thing, per_k=STEEL_PER_K)
    sessions = int(rng.integers(4, 9))
    rows = int(rng.integers(240, 481)) // sessions
    restless = 4.0 if kind == "lag" else 1.0  # slower drifts show no lag
    plan = Plan(4 if held else 0, sessions, rows, 2 if rows < 60 else 3, restless)
    readings = measure(rng, machine, thing, plan)
    scene = Scene(machine, readings, (readings.session >= plan.before) | (kind in OLDER))
    known = readings.session < plan.sessions - 1
    seat_mm = np.full(len(readings.q), machine.seat_mm)
    if kind == "floor":
        seat_mm[readings.session == rng.integers(plan.before, plan.sessions - 1)] *= SHAKEN
    seen = Seen(machine, readings.only(known), seat_mm[known])
    planted = "disc" if kind in MESSES and seed % 2 else OLDER.get(kind, kind)
    none = scene.none()
    fault = Fault("", "", (), none, "")
    if planted in FAULTS:
        wanted = float(np.exp(rng.uniform(*np.log(PLAINLY if kind in OLDER else WANTED))))
        fault = _sized(FAULTS[planted](rng, scene), seen, known, wanted)
        fault = _with_its_like(fault, seen, scene, known)
    spread = _noise_mm(machine, readings.only(~known))
    truth = Truth(
        kind, seed, fault.cause, fault.location, fault.depends_on, fault.beside,
        fault.same_signal, fault.needs, seen.noise_units(_rows(fault.alter, known)), fault.words,
        _placement(fault, plan, readings) if fault.cause == "artefact_moved" else "", held,
        1e3 * float(np.sqrt((spread**2).mean())),
    )  # fmt: skip
    return Case(truth, machine, thing, plan, readings, seat_mm, fault.alter, rng)


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


def _noise_mm(machine: Machine, readings: Readings) -> F64:
    """(n,) the 3-D standard deviation of each reading."""
    jacobian = by_angles(posture(machine.built, readings.q, readings.warm))
    variance = machine.encoder_rad**2 * (jacobian**2).sum(axis=(1, 2)) + 3 * machine.seat_mm**2
    spread: F64 = np.sqrt(variance)
    return spread


def _session_name(plan: Plan, session: int) -> str:
    if session < plan.before:
        return f"before-{session + 1}"
    number = session - plan.before + 1
    return f"session-{number}" if number <= plan.diagnosed else "further"


def _placement(fault: Fault, plan: Plan, readings: Readings) -> str:
    row = int(np.flatnonzero(fault.alter.target.any(axis=1))[0])
    name = _session_name(plan, int(readings.session[row]))
    return f"{name} P{readings.placement[row] % plan.placements + 1}"


def write(case: Case, folder: Path) -> None:
    """All files of the case into *folder*, which exists."""
    (folder / "arm.toml").write_text(_arm_toml(case.machine), encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps(asdict(case.truth), indent=1), encoding="utf-8")
    machine, readings, rng, kind = case.machine, case.readings, case.rng, case.truth.kind
    shape = readings.q.shape

    def noise(size: tuple[int, ...]) -> F64:
        return rng.standard_t(3, size) / np.sqrt(3) if kind == "t3" else rng.standard_normal(size)

    diagnosed = (readings.session >= case.plan.before) & (
        readings.session < case.plan.sessions - 1
    )  # fmt: skip
    touched = readings.goal + case.alter.target + case.seat_mm[:, None] * noise((shape[0], 3))
    if kind == "gross":
        off = diagnosed & (rng.random(shape[0]) < GROSS)
        away = rng.standard_normal((shape[0], 3))
        away *= rng.uniform(0.1, 1.0, (shape[0], 1)) / np.linalg.norm(away, axis=1, keepdims=True)
        touched = touched + away * off[:, None]
    true, miss = solve(machine.built, readings.q, touched, readings.warm, case.alter)
    assert miss.max() < 1e-6, "an altered arm does not reach its point"
    q = true + case.alter.encoder + machine.encoder_rad * noise(shape)
    sensors = 20 + readings.warm + case.alter.sensor + SENSOR_K * rng.standard_normal(shape)
    text = np.char.mod("%.2f", sensors).astype(object)
    if kind == "dead":
        k = int(rng.integers(1, machine.joints - 1))
        since = case.plan.before + case.plan.diagnosed // 2
        still = "" if rng.random() < 0.5 else text[0, k]
        text[diagnosed & (readings.session >= since), k] = still
    unit = str(rng.choice(["rad", "deg"]))
    for session in range(case.plan.sessions):
        rows = list(np.flatnonzero(readings.session == session))
        if kind == "doubled" and diagnosed[rows[0]]:
            rows = sorted(rows + [row for row in rows if rng.random() < TWICE])
        _write_session(case, folder, session, rows, q, text, unit)


def _write_session(
    case: Case, folder: Path, session: int, rows: list[int], q: F64, sensors: F64, unit: str
) -> None:
    readings, joints = case.readings, range(1, case.machine.joints + 1)
    place = folder / _session_name(case.plan, session)
    place.mkdir()
    began = float(np.floor(readings.time_s[rows[0]]))
    started = (BEGAN + datetime.timedelta(seconds=began)).strftime("%Y-%m-%dT%H:%M:%SZ")
    lines = [
        'schema = "armd.session/1"', 'arm = "OUTSIDER"', f"started = {started}",
        f'angle_unit = "{unit}"', "[artefact]", f'name = "{case.thing.name}"',
        f"expansion_per_k = {case.thing.per_k}",
    ]  # fmt: skip
    for number, point in enumerate(case.thing.points, 1):
        lines += [
            "[[artefact.target]]", f'name = "B{number}"',
            f"position_mm = {json.dumps(point.tolist())}",
        ]  # fmt: skip
    (place / "session.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    shown = np.degrees(q) if unit == "deg" else q
    with (place / "readings.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(
            ["time_s", "placement", "target", *(f"q{k}" for k in joints),
             *(f"w{k}" for k in joints), *(f"t{k}" for k in joints), "artefact_c"]
        )  # fmt: skip
        placements = readings.placement[rows]
        first = np.append(True, placements[1:] != placements[:-1])
        for i, new in zip(rows, first, strict=True):
            read = new or case.truth.kind != "unread"
            table.writerow(
                [f"{readings.time_s[i] - began:.2f}",
                 f"P{readings.placement[i] % case.plan.placements + 1}",
                 f"B{readings.target[i] + 1}", *(f"{angle:.9f}" for angle in shown[i]),
                 *(f"{rate:.5f}" for rate in readings.rate[i]), *sensors[i],
                 f"{20 + readings.artefact_k[i]:.2f}" if read else ""]
            )  # fmt: skip


def _arm_toml(machine: Machine) -> str:
    drawn = machine.drawn
    lines = ['schema = "armd.arm/1"', 'serial_number = "OUTSIDER"']
    for k in range(machine.joints):
        lines += ["[[temperature_sensor]]", f'name = "t{k + 1}"']
    for k in range(machine.joints):
        middle = (-0.5 * machine.along(k)).round(2).tolist()
        lines += [
            "[[joint]]", f"theta_deg = {np.degrees(drawn.theta[k])}", f"d_mm = {drawn.d[k]}",
            f"a_mm = {drawn.a[k]}", f"alpha_deg = {np.degrees(drawn.alpha[k])}",
            f'temperature = "t{k + 1}"', f"mass_kg = {machine.mass_kg[k]:.4f}",
            f"centre_of_mass_mm = {json.dumps(middle)}",
        ]  # fmt: skip
    lines += ["[tip]", f"offset_mm = {json.dumps(drawn.tip.tolist())}", "radius_mm = 3.0"]
    return "\n".join(lines) + "\n"

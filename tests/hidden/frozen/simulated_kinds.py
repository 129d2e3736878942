"""The kinds drawn by armd's own simulator; each takes a generator, a number, and says what to make.

The number goes round the causes, so that a few cases of a kind already have different ones.
"""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from hidden.frozen.from_simulator import Made, change_rows, under_calibration

from armd.simulator.campaigns.hidden import DESIGNS, NOISE, Design
from armd.simulator.hidden import generate_case
from armd.simulator.measured.mess import KINDS as MESSES
from armd.simulator.plants.causes import CAUSES
from armd.simulator.plants.draw import draw_plant
from armd.simulator.plants.drift import draw_drift
from armd.simulator.plants.plant import Plant

Rng = np.random.Generator
DESIGN = Design(sessions=6, articulations=4, holdout=2)
NAMED = [cause for cause in CAUSES if cause != "unknown"]
#: What of a mess is true: reported or not, it does not count.
OF_THE_MESS = {"gross": "outliers", "t3": "outliers", "touched": "artefact_moved"}
MESSY = (
    "encoder_eccentricity", "encoder_ellipticity", "encoder_periodic", "joint_backlash",
    "axis_wobble", "joint_compliance", "link_bending", "probing_force", "time_skew",
    "artefact_length", "geometry_shift",
)  # fmt: skip
CLEAN_NOISES = (
    NOISE, replace(NOISE, tails="heavy"), replace(NOISE, wander_um=3.0), replace(NOISE, tails="t3"),
    replace(NOISE, correlation=0.6), replace(NOISE, sensor_step_c=0.0625),
)  # fmt: skip
POOR = ("few", "isothermal", "static", "poor", "short range", "uncertified")
#: Temperatures of the sessions from before, by how many there are.
CALIBRATED_AT = {1: (20.0,), 2: (16.0, 24.0), 4: (14.0, 18.0, 22.0, 26.0)}
LEVELS = (16.0, 19.0, 22.0, 25.0, 28.0)
THERMAL = (
    "one", "all", "joint_thermal", "nonlinear_expansion", "thermal_lag", "thermal_gradient", "clean"
)  # fmt: skip
GROWN = (1, 2, 4)  # links long enough for their growth to show


def _calibrated(made: Made, before: int = 4) -> Made:
    return replace(made, design=replace(made.design, before=before))


def _with(plants: list[Plant], design: Design = DESIGN, held: bool | None = None) -> Made:
    made = Made(tuple(plants), design)
    return _calibrated(made) if under_calibration(plants) or held else made


def single(rng: Rng, number: int) -> Made:
    cause = NAMED[number % len(NAMED)]
    return _with([draw_plant(rng, [cause], float(np.exp(rng.uniform(-0.2, 0.7))))])


def faint(rng: Rng, number: int) -> Made:
    cause = NAMED[(7 * number) % len(NAMED)]
    return _with([draw_plant(rng, [cause], float(np.exp(rng.uniform(-2.0, -1.2))))])


def pair(rng: Rng, number: int) -> Made:
    causes = rng.choice([c for c in NAMED if c != "outliers"], 2 + number % 2, replace=False)
    return _with([draw_plant(rng, [str(cause)]) for cause in causes])


def crowd(rng: Rng, number: int) -> Made:
    known = [c for c in NAMED if c not in ("outliers", "artefact_sag")]
    causes = rng.choice(known, 4 + number % 2, replace=False)
    return _with([draw_plant(rng, [str(cause)], 1.5) for cause in causes])


def messy(rng: Rng, number: int) -> Made:
    mess = MESSES[number % len(MESSES)]
    # every other round of the messes has a cause, and another half a calibration from before
    planted, held = (number // len(MESSES)) % 2 == 0, bool(number % 2)
    plants = [draw_plant(rng, MESSY, float(np.exp(rng.uniform(0.4, 1.4))))] if planted else []
    location = {"outliers": "rows", "artefact_moved": "artefact"}
    neutral = tuple((c, location[c]) for c in [OF_THE_MESS[mess]]) if mess in OF_THE_MESS else ()
    made = _with(plants, replace(DESIGN, holdout=1), held)
    words = " + ".join([mess, *(f"{p.cause} {p.location} {p.size:.3g}" for p in plants)])
    return replace(made, mess=mess, words=words, neutral=neutral)


def drift(rng: Rng, number: int) -> Made:
    plant = draw_drift(rng)
    made = _with([plant], held=bool(number % 2)) if number % 2 else Made((plant,), DESIGN)
    words = f"{plant.cause} {plant.location} {plant.detail['course']} {plant.size:.3g}"
    return replace(made, words=words, neutral_variables=("time_s",))


def poor(rng: Rng, number: int) -> Made:
    name = POOR[number % len(POOR)]
    cause = NAMED[(5 * number) % len(NAMED)]
    design = replace(DESIGNS[name], sessions=min(DESIGNS[name].sessions, 6))
    made = _with([draw_plant(rng, [cause], 1.5)], design)
    return replace(made, words=f"{name}: {cause} {made.plants[0].location}")


def clean(rng: Rng, number: int) -> Made:
    made = _with([], held=(number // len(CLEAN_NOISES)) % 2 == 1)
    noise = CLEAN_NOISES[number % len(CLEAN_NOISES)]
    return replace(made, noise=noise, words=f"clean, noise {number % len(CLEAN_NOISES)}")


def foreign(rng: Rng, number: int) -> Made:
    """One of the sessions was measured with another arm."""
    other, which = int(rng.integers(1 << 30)), int(rng.integers(1, DESIGN.sessions + 1))
    name = f"session-{which}"

    def exchange(folder: Path) -> None:
        beside = folder / "another"
        generate_case(beside, other, (), replace(DESIGN, before=0))
        shutil.rmtree(folder / name)
        (beside / name).rename(folder / name)
        shutil.rmtree(beside)

    made = _with([] if number % 2 else [draw_plant(rng, MESSY, 1.5)], held=True)
    return replace(made, words=f"{name} of another arm", refusable=name, after=exchange)


def turn(rng: Rng, number: int) -> Made:
    """An encoder that restarted a turn off, within a session or between two."""
    joint, which = int(rng.choice([1, 4, 6])), int(rng.integers(2, DESIGN.sessions + 1))
    sign, half = float(rng.choice([-1.0, 1.0])), bool(number % 2)

    def restart(folder: Path) -> None:
        path = folder / f"session-{which}" / "readings.csv"
        with path.open(encoding="utf-8") as file:
            count = len(list(csv.DictReader(file)))
        row_number = iter(range(count))

        def change(row: dict[str, str]) -> None:
            if not half or next(row_number) >= count // 2:
                row[f"q{joint}"] = f"{float(row[f'q{joint}']) + sign * 2 * np.pi:.9f}"

        change_rows(path, change)

    made = _with([] if number % 4 < 2 else [draw_plant(rng, MESSY, 1.5)], held=bool(number % 2))
    words = f"joint {joint} a turn off in session-{which}{', half of it' if half else ''}"
    return replace(made, words=words, after=restart)


def thermal(temperatures: int) -> Callable[[Rng, int], Made]:
    """A calibration made at so many temperatures, and each thermal cause."""

    def draw(rng: Rng, number: int) -> Made:
        what, in_order = THERMAL[number % len(THERMAL)], (number // len(THERMAL)) % 2 == 0
        levels = LEVELS if rng.random() < 0.5 else LEVELS[::-1]
        if not in_order:
            levels = tuple(float(level) for level in rng.permutation(levels))
        # Under one temperature the arm grows by nothing else, save where its own growth is asked.
        demo = temperatures == 1 and (what == "thermal_lag" or (what == "all" and not in_order))
        design = Design(
            sessions=5, articulations=4, holdout=2, before=4, levels_c=levels,
            expanding=temperatures > 1 or demo,
            ramps=3 if what == "thermal_lag" else 1,
            ramp_k_per_h=8.0 if what == "thermal_lag" else 4.0,
        )  # fmt: skip
        earlier = replace(
            design, levels_c=CALIBRATED_AT[temperatures], ramp_k_per_h=0.0,
            heated_links=temperatures > 1,
        )  # fmt: skip
        plants = _thermal_plants(rng, what, demo)
        order = "in order" if in_order else "out of order"
        names = " + ".join(f"{p.cause} {p.location} {p.size:.3g}" for p in plants)
        return Made(
            tuple(plants), replace(design, earlier=earlier), growing=demo,
            words=f"{temperatures} temperatures, {order}: "
            f"{names or 'nothing planted'}{', all links grow' if demo else ''}",
        )  # fmt: skip

    return draw


def _thermal_plants(rng: Rng, what: str, demo: bool) -> list[Plant]:
    if what == "one":
        return [draw_plant(rng, ["link_expansion"], float(rng.uniform(0.4, 1.2)))]
    if what == "all":
        each = [draw_plant(rng, ["link_expansion"], 0.8) for _ in GROWN]
        planted = zip(each, GROWN, strict=True)
        return [] if demo else [replace(p, location=f"link {k}") for p, k in planted]
    if what == "clean":
        return []
    return [draw_plant(rng, [what], float(np.exp(rng.uniform(0.0, 0.7))))]


KINDS: dict[str, tuple[Callable[[Rng, int], Made], int]] = {
    "single": (single, 36), "pair": (pair, 12), "crowd": (crowd, 6), "faint": (faint, 6),
    "messy": (messy, 16), "drift": (drift, 6), "poor": (poor, 6), "clean": (clean, 12),
    "foreign": (foreign, 3), "turn": (turn, 4), "thermal-1": (thermal(1), 14),
    "thermal-2": (thermal(2), 14), "thermal-4": (thermal(4), 14),
}  # fmt: skip

"""Changes to plant in histories of checks, drawn: cause, place, size, day, artefact, bad checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.interim.checks.columns import Cause
from armd.simulator.campaigns import interim
from armd.simulator.plants.causes import CAUSES
from armd.simulator.plants.plant import Plant

DAYS = 32
#: Onsets to draw from: with checks enough before to know the arm, and behind to see it.
ONSETS = (8, 20)
#: Sizes, in typical ones: small, as they come, large; each with a spread of ±30 %.
FACTORS = (0.1, 0.3, 1.0)
#: cause → joints it is planted at
SUDDEN: dict[str, tuple[int, ...]] = {
    "encoder_slip": (2, 3, 4, 5),
    "geometry_shift": (2, 3, 4, 5),
    "tip_offset": (0,),
    "encoder_eccentricity": (2, 3, 4, 5),
}
GROWING: dict[str, tuple[int, ...]] = {
    "geometry_shift": (2, 3, 4, 5),
    "joint_compliance": (2, 3),
    "joint_backlash": (2, 3, 4, 5),
    "tip_offset": (0,),
}


@dataclass(frozen=True)
class Case:
    """One history with one change."""

    seed: int
    plant: Plant
    day: float
    grows: bool
    artefact: str
    bad: tuple[tuple[interim.Bad, int], ...]

    @property
    def happening(self) -> interim.Happening:
        return interim.Happening(self.plant, self.day, self.grows)

    @property
    def history(self) -> interim.CheckSeries:
        return interim.CheckSeries(DAYS, (self.happening,), self.bad, self.artefact)

    @property
    def used(self) -> F64:
        return interim.use(DAYS, self.seed)

    @property
    def bad_checks(self) -> list[int]:
        return [day - 1 for _, day in self.bad]

    @property
    def words(self) -> str:
        detail = " ".join(str(v) for v in self.plant.detail.values())
        grows = "+" if self.grows else ""
        return (
            f"{self.plant.cause} {self.plant.location} {detail} {self.plant.size:.2f}"
            f"@{self.day:g}{grows} on {self.artefact}"
        )


def draw(seed: int, rng: np.random.Generator) -> Case:
    grows = bool(rng.uniform() < 0.4)
    table = GROWING if grows else SUDDEN
    cause = str(rng.choice(list(table)))
    joint = int(rng.choice(table[cause]))
    size = CAUSES[cause].typical * float(rng.choice(FACTORS)) * float(np.exp(rng.normal(0, 0.3)))
    detail: dict[str, float | str] = {}
    if cause == "geometry_shift":
        known = ["alpha", "d", "a", *(["theta"] if grows else [])]
        parameter = str(rng.choice(known))
        detail["parameter"] = parameter
        if parameter == "d":  # along parallel axes a shift of one joint is that of the other
            joint = int(rng.choice([4, 5]))
    location = "tip" if joint == 0 else f"joint {joint}"
    day = float(rng.integers(*ONSETS, endpoint=True))
    bad: tuple[tuple[interim.Bad, int], ...] = ()
    if rng.uniform() < 0.4:
        kind = interim.BAD[int(rng.integers(2))]
        bad = ((kind, int(rng.integers(3, DAYS - 3))),)
    artefact = str(rng.choice(list(interim.ARTEFACTS)))
    return Case(seed, Plant(cause, location, size, detail), day, grows, artefact, bad)


def true_cause(case: Case, causes: Sequence[Cause]) -> int:
    for k, cause in enumerate(causes):
        if cause.place != (case.plant.cause, case.plant.location):
            continue
        wanted = case.plant.detail.get("parameter")
        if wanted is None or cause.candidate.columns[0].name == wanted:
            return k
    raise AssertionError(case.words)

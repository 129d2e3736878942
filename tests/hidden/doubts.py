"""Cases whose data leave a doubt, and whether the next experiment that armd proposes settles it.

Causes are drawn whose rivals another experiment can tell apart. Two that are one signal in every
experiment (a link's length that shifted, and an offset of its sensor) are not drawn; where such a
pair turns up all the same it counts as open.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from cases import HELD

from armd.compensation.data.sessions.session import load_session
from armd.compensation.design.conditions import HEATED_K
from armd.compensation.design.design import Experiment, design
from armd.compensation.diagnose.constants import SURE
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.report.advice import Doubt, find_most_doubtful
from armd.simulator.campaigns.hidden import Design
from armd.simulator.hidden import generate_case
from armd.simulator.measured.plan import Climate
from armd.simulator.plants.causes import CAUSES
from armd.simulator.plants.draw import draw_plant
from armd.simulator.plants.plant import Plant
from support.made_case import read_case
from support.next_session import measure_next
from support.warmed_climate import warmed

#: Less than a third of the standard design's readings.
LITTLE = Design(sessions=4, articulations=3, holdout=0)
#: Joint angles, degrees, within which a range is drawn: all others reach a whole artefact.
MIDDLE = {1: (-180, 180), 2: (-30, 130), 3: (-155, -50), 4: (-180, 180), 5: (-115, 115)}
#: Curves of a joint's angle: over a short range nearly one.
CURVES = ("encoder_eccentricity", "encoder_ellipticity", "encoder_periodic", "encoder_scale")
#: Under a calibration from before, at one other temperature: each a constant shift.
SHIFTS = ("joint_thermal", "link_expansion", "artefact_expansion", "geometry_shift")
#: With few readings one passes for another.
ANY = tuple(cause for cause in CAUSES if cause not in ("sensor_offset", "outliers", "unknown"))
#: Why data are doubtful, and how often such are drawn: few readings seldom leave a doubt.
REASONS = {"short range": 0.3, "one temperature": 0.2, "few readings": 0.5}


@dataclass(frozen=True)
class Doubtful:
    """A cause, and a way to measure that leaves it in doubt."""

    reason: str  # one of REASONS
    plant: Plant
    measured: Design


@dataclass(frozen=True)
class Settled:
    """What came of a doubt."""

    doubt: Doubt
    proposed: Experiment
    after: Diagnosis  # of all sessions together
    resolved: bool

    @property
    def proposal(self) -> str:
        done = self.proposed
        return (
            f"{len(done.tip_mm)} poses, {done.climate.words}, {done.before:.1f} to "
            f"{done.after:.1f} {done.criterion.unit}"
        )


def draw_doubtful(rng: np.random.Generator) -> Doubtful:
    """One of REASONS, a cause that suits it, of half to three times its typical size."""
    reason = str(rng.choice(list(REASONS), p=list(REASONS.values())))
    factor = float(np.exp(rng.uniform(-0.7, 1.1)))
    match reason:
        case "short range":
            plant = _draw(rng, CURVES, factor)
            middle, width = MIDDLE[plant.number], rng.uniform(50.0, 90.0)
            low = rng.uniform(middle[0], middle[1] - width)
            measured = replace(LITTLE, ranges_deg={plant.number: (low, low + width)})
        case "one temperature":
            plant = _draw(rng, SHIFTS, factor)
            air = 20.0 + float(rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 8.0))
            still = replace(LITTLE, ramp_k_per_h=0.0, heated_links=False)
            measured = replace(still, celsius=(air, air), before=6, earlier=Design())
        case _:
            plant = _draw(rng, ANY, factor)
            measured = replace(LITTLE, sessions=2, articulations=int(rng.integers(2, 4)))
            if plant.cause in HELD:
                measured = replace(measured, before=6, earlier=Design())
    return Doubtful(reason, plant, measured)


def _draw(rng: np.random.Generator, causes: tuple[str, ...], factor: float) -> Plant:
    """No curve of a joint whose range cannot be short; no length that shifted."""
    while True:
        plant = draw_plant(rng, causes, factor)
        curve_elsewhere = causes == CURVES and plant.number not in MIDDLE
        if not curve_elsewhere and plant.detail.get("parameter") not in ("a", "d"):
            return plant


def settle(folder: Path, seed: int, case: Doubtful) -> tuple[Diagnosis, Settled | None]:
    """Diagnose a case; where that is in doubt, measure what armd proposes, and diagnose again."""
    hidden = generate_case(folder, seed, [case.plant], case.measured)
    made = read_case(hidden)
    arm, sessions, calibration = made.arm, made.sessions, made.calibrate_before()
    before = diagnose(sessions, arm, calibration)
    doubt = find_most_doubtful(before)
    if doubt is None:
        return before, None
    proposed = design(before)
    climate = Climate(proposed.climate.air_c)
    if proposed.climate.heated:
        climate = warmed(climate, arm.sensors.index(proposed.climate.heated), HEATED_K)
    q, sides = proposed.states.q, proposed.states.rate
    path = measure_next(hidden, folder / "next", q, climate, sides=sides, seed=seed)
    after = diagnose([*sessions, load_session(path, arm)], arm, calibration)
    return before, Settled(doubt, proposed, after, resolved(after, case.plant))


def resolved(diagnosis: Diagnosis, plant: Plant) -> bool:
    """The cause is found at its place, surely, and nothing is in doubt any more."""
    truth = (plant.cause, plant.location)
    sure = [f.candidate.place for f in diagnosis.findings if f.probability > SURE]
    return truth in sure and find_most_doubtful(diagnosis) is None

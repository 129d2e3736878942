"""Cases in which something drifts, and whether what is said of them is right.

Right: the place is named with a smooth course in time, or is told as unknown in time alone; no
step, and nothing else. What drifts here has no sensor; its
courses (`simulator.truth.course`) are laws of their own, none of them the diagnosis's.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from cases import NOISES, at_most, projected_snr

from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.simulator.campaigns.hidden import Design
from armd.simulator.plants.drift import draw_drift
from armd.simulator.plants.plant import Plant
from support.made_case import make_case
from support.planting import rms_um

KINDS = ("drift", "still")
SURE = 0.95


@dataclass(frozen=True)
class Said:
    """One finding as it is told."""

    cause: str
    location: str
    probability: float
    depends_on: tuple[str, ...]
    stepped: bool  # at an instant
    shown: bool  # by readings held out


@dataclass(frozen=True)
class Drifted:
    """What came of a case in which something drifts, or nothing does."""

    kind: str
    seed: int
    truth: str
    snr: float
    said: tuple[Said, ...]
    right: bool
    sure_and_wrong: int
    false_alarm: bool
    before_um: float  # on sessions held out, which come after the others
    after_um: float
    oracle_um: float
    seconds: float

    @property
    def worse(self) -> float:
        """By what share the extended model errs more on sessions held out."""
        return self.after_um / self.before_um - 1.0


def said(diagnosis: Diagnosis) -> tuple[Said, ...]:
    return tuple(
        Said(
            found.candidate.cause,
            str(found.candidate.location),
            found.probability,
            found.candidate.depends_on,
            any(name == "instant" for name, *_ in found.candidate.setting),
            gain.is_confirmed,
        )
        for found, gain in zip(diagnosis.findings, diagnosis.gains, strict=True)
    )


def tells(one: Said, plant: Plant, held: bool) -> bool:
    """Whether a finding says what drifts, or honestly that something does."""
    smooth = not one.stepped and "time_s" in one.depends_on
    # Under a calibration from before, what had come when the readings began is a constant.
    smooth |= held and not one.depends_on
    if one.cause == "unknown":
        return smooth and set(one.depends_on) == {"time_s"}
    return smooth and (one.cause, one.location) == (plant.cause, plant.location)


def run_drift(kind: str, seed: int) -> Drifted:
    """Kind "drift": under what is made of the same sessions, or a calibration from before, by
    turns; "still": nothing drifts but the noise's own slow wandering of the base."""
    rng = np.random.default_rng([seed, 0xD21F])
    plants = [draw_drift(rng)] if kind == "drift" else []
    noise = NOISES["gaussian" if plants else "slow drift"]
    held = bool(rng.integers(2))
    design = replace(Design(), before=6 if held else 0)
    made = make_case(seed, plants, design, noise)
    calibration = made.calibrate_before()
    started = time.perf_counter()
    diagnosis = diagnose(made.sessions, made.arm, calibration)
    seconds = time.perf_counter() - started
    snr = 0.0
    for error_mm in made.errors_mm():
        snr = projected_snr(diagnosis.search.first, error_mm, diagnosis.search.last.noise)
    told = said(diagnosis)
    wrong = [one for one in told if not (plants and tells(one, plants[0], held))]
    return Drifted(
        kind,
        seed,
        _words(plants, held),
        snr,
        told,
        bool(told) and not wrong if plants else not told,
        sum(one.probability >= SURE and one.cause != "unknown" for one in wrong),
        bool(told) and not plants,
        rms_um(made.holdout, made.arm, diagnosis.baseline.calibration),
        rms_um(made.holdout, made.arm, diagnosis.extended),
        made.case.oracle_rms_um(made.case.holdout),
        seconds,
    )


def _words(plants: list[Plant], held: bool) -> str:
    under = "held" if held else "own"
    if not plants:
        return f"clean ({under})"
    (plant,) = plants
    what = plant.detail.get("parameter", "")
    return (
        f"{plant.cause} {plant.location} {what} {plant.detail['course']} {plant.size:.3g} ({under})"
    )


def tell(one: Drifted) -> str:
    found = "; ".join(
        f"{s.cause} {s.location} {s.probability:.2f}{' step' if s.stepped else ''}"
        f"{'' if s.shown else ' (lead)'}"
        for s in one.said
    )
    return (
        f"{'ok ' if one.right else '-- '}{one.kind} {one.seed}: {one.truth} [SNR {one.snr:.1f}] → "
        f"{found or 'silence'}; {one.before_um:.2f} → {one.after_um:.2f} "
        f"(oracle {one.oracle_um:.2f}) µm, {one.seconds:.1f} s"
    )


def rows(outcomes: list[Drifted]) -> list[tuple[str, str, str]]:
    """What was reached and the marks, of the cases that could show (SNR over 8)."""
    seen = [o for o in outcomes if o.kind == "drift" and o.snr > 8.0]
    still = [o for o in outcomes if o.kind == "still"]
    table = []
    for label, of in (("drift, SNR over 8", seen), ("slow wandering, nothing drifts", still)):
        if of:
            right, wrong = sum(o.right for o in of), sum(o.sure_and_wrong > 0 for o in of)
            worse = [o for o in of if o.worse > 0.002]
            most = 100 * max([0.0, *(o.worse for o in of)])
            table += [
                (f"{label}: right", f"{right} of {len(of)}", "0.90" if of is seen else "0.98"),
                (f"{label}: sure and wrong", at_most(wrong, len(of)), "0.02"),
                (
                    f"{label}: extended model worse",
                    f"{len(worse)} of {len(of)}, by {most:.1f} %",
                    "0.01, by 2 %",
                ),
            ]
    return table

"""Cases in which measuring went as it does in a workshop: what a diagnosis then says, and should.

Every other case has a cause planted, every other pair of them a calibration from before to test.
"""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, replace

import numpy as np
from cases import at_most

from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.report.result import as_json
from armd.compensation.model.calibration import Calibration
from armd.compensation.report.diagnosis.page import make_diagnosis_report
from armd.simulator.campaigns.hidden import Design
from armd.simulator.plants.draw import draw_plant
from armd.simulator.plants.plant import Plant
from support.made_case import MadeCase, make_case
from support.planting import rms_um

DESIGN = Design(sessions=6, articulations=4, holdout=1)
#: Causes that act through the posture: a dead channel or a wrong clock takes none of them away.
CAUSES = (
    "encoder_eccentricity", "encoder_ellipticity", "encoder_periodic", "joint_backlash",
    "axis_wobble", "joint_compliance", "link_bending", "probing_force", "time_skew",
    "artefact_length", "geometry_shift",
)  # fmt: skip
#: What is told of a mess itself is no false alarm.
OF_THE_MESS = {"gross": "outliers", "t3": "outliers", "touched": "artefact_moved"}
SURE = 0.95
SEEN = 8.0  # noise units from which on a cause should be named


@dataclass(frozen=True)
class MessOutcome:
    """What came of one case, small enough to pass between processes."""

    kind: str
    seed: int
    truth: tuple[str, str, float] | None
    snr: float
    held: bool
    found: tuple[tuple[str, str, float], ...]  # cause, location, probability
    told: tuple[str, ...]  # what is said of the readings themselves
    floor: float  # the noise floor told, over the true one
    before_um: float  # on the session held out
    after_um: float
    seconds: float
    headings: tuple[str, ...]  # of the report

    @property
    def foreign(self) -> list[tuple[str, str, float]]:
        """Findings that are neither the cause nor the mess."""
        truth = self.truth[:2] if self.truth else None
        return [f for f in self.found if f[:2] != truth and f[0] != OF_THE_MESS.get(self.kind, "-")]

    @property
    def right(self) -> bool:
        """The cause, where it is large enough, is named, what was touched is told, no more."""
        named = self.truth is None or any(f[:2] == self.truth[:2] for f in self.found)
        if self.truth is not None and self.snr < SEEN:
            named = True
        told = self.kind != "touched" or any(f[0] == "artefact_moved" for f in self.found)
        told = told and (
            self.kind not in ("doubled", "dead", "clocks", "power_on", "restarted")
            or bool(self.told)
        )
        return named and told and not self.foreign

    @property
    def sure_and_wrong(self) -> bool:
        return any(p >= SURE and cause != "unknown" for cause, _, p in self.foreign)

    @property
    def worse(self) -> bool:
        return self.after_um > 1.02 * self.before_um


def run_mess(kind: str, seed: int, design: Design = DESIGN) -> MessOutcome:
    """Make, diagnose and judge a case of *kind*, one of the simulator's `mess.KINDS`, or ""."""
    rng = np.random.default_rng([seed, 0x3E55])
    plants: list[Plant] = []
    if seed % 2:
        plants = [draw_plant(rng, CAUSES, float(np.exp(rng.uniform(0.4, 1.4))))]
    held = seed % 4 > 1 or any(plant.cause == "geometry_shift" for plant in plants)
    design = replace(design, before=4) if held else design
    made = make_case(seed, plants, design, mess=kind)
    calibration = made.calibrate_before()
    started = time.perf_counter()
    diagnosis = diagnose(made.sessions, made.arm, calibration)
    seconds = time.perf_counter() - started
    result = as_json(diagnosis, None)
    headings = re.findall("<h[23]>([^<]*)", make_diagnosis_report(diagnosis, result, {}, ()))
    truth = (plants[0].cause, plants[0].location, plants[0].size) if plants else None
    return MessOutcome(
        kind, seed, truth, _snr(made) if plants else 0.0, held,
        tuple((f["cause"], f["location"], float(f["probability"])) for f in result["findings"]),
        tuple(result.get("readings", {}).get("told", ())),
        result["baseline"]["noise_floor_um"] / _true_floor_um(made),
        _held_out_um(made, diagnosis.baseline.calibration),
        _held_out_um(made, diagnosis.extended),
        seconds, tuple(headings),
    )  # fmt: skip


def _snr(made: MadeCase) -> float:
    """Norm of the effect over the noise, not clear of what absorbs; about twice what is clear."""
    (error,) = made.errors_mm()
    error -= error.mean(axis=0)
    per_axis = _true_floor_um(made) / 1e3 / np.sqrt(3.0)
    return 0.5 * float(np.linalg.norm(error)) / per_axis


def _true_floor_um(made: MadeCase) -> float:
    """3-D RMS of what encoders, seats and certificates err by, gross errors aside."""
    case = made.case
    rows = [case.noise_mm[path.name][~case.measured[path.name].spoilt] for path in case.sessions]
    return 1e3 * float(np.sqrt((np.concatenate(rows) ** 2).sum(axis=1).mean()))


def _held_out_um(made: MadeCase, model: Calibration) -> float:
    """3-D RMS on the session held out, its gross errors aside."""
    kept = [s.rows(~made.case.measured[s.name].spoilt) for s in made.holdout]
    return rms_um(kept, made.arm, model)


def tell_mess(o: MessOutcome) -> str:
    truth = f"{o.truth[0]} {o.truth[1]} {o.truth[2]:.3g}" if o.truth else "clean"
    found = "; ".join(f"{c} {where} {p:.2f}" for c, where, p in o.found) or "silence"
    marks = ("SURE AND WRONG " if o.sure_and_wrong else "") + ("WORSE " if o.worse else "")
    held = ", held" if o.held else ""
    return (
        f"{'ok ' if o.right else '-- '}{marks}{o.kind or 'tidy'} {o.seed}: {truth} "
        f"[SNR {o.snr:.0f}{held}] → {found}; floor × {o.floor:.2f}, "
        f"{o.before_um:.1f} → {o.after_um:.1f} µm, {o.seconds:.1f} s {' '.join(o.told)}"
    )


def table_of_mess(outcomes: list[MessOutcome]) -> None:
    """One line per kind; the marks: 90 % right, at most 2 % sure and wrong, false or worse."""
    if not outcomes:
        return
    print(f"{'':12s} {'right':>8s} {'sure+wrong':>16s} {'false':>9s} {'worse':>6s} {'floor':>12s}")
    for kind in dict.fromkeys(o.kind for o in outcomes):
        own = [o for o in outcomes if o.kind == kind]
        clean = [o for o in own if o.truth is None]
        alarms = sum(bool(o.foreign) for o in clean)
        floors = [o.floor for o in own]
        sure = at_most(sum(o.sure_and_wrong for o in own), len(own))
        print(
            f"{kind or 'tidy':12s} {sum(o.right for o in own):3d}/{len(own):<4d} "
            f"{sure:>16s} {alarms:4d}/{len(clean):<4d} "
            f"{sum(o.worse for o in own):6d} {min(floors):5.2f}–{max(floors):5.2f}"
        )

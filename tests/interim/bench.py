"""An arm of a seed with its calibration, and checks of it by the simulator's physics."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from drawn_changes import Case

from armd.arrays import F64
from armd.compensation.data.sessions.session import load_session
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.interim.checks.chain import HistoryLine
from armd.compensation.interim.checks.columns import list_causes
from armd.compensation.interim.checks.history import Check
from armd.compensation.interim.checks.reduce import reduce
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import Calibration, save_calibration
from armd.simulator.campaigns import interim
from armd.simulator.campaigns.calibration import plan_calibration as calibration_campaign
from armd.simulator.measured.artefact import Artefact
from armd.simulator.measured.measuring import (
    Measured,
    measure_campaign,
    take_readings,
    write_session,
)
from armd.simulator.measured.noise import Noise
from armd.simulator.measured.placement import Placement
from armd.simulator.measured.plan import Climate, SessionPlan, Visit
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.nominal import SELF_HEATING_W

#: A check that was advised is made so long after the day's usual one.
LATER_H = 4.0


class Bench:
    """An arm of a seed, its arm.toml and its calibration."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.seed, self.folder = seed, folder
        folder.mkdir()
        path = folder / "arm.toml"
        path.write_text(nominal.make_arm_toml())
        self.arm: Arm = load_arm(path)
        campaign = calibration_campaign(seed, Noise())
        sessions = []
        for measured in measure_campaign(campaign, np.random.default_rng([seed, 0x5E55])):
            write_session(folder / measured.plan.name, measured)
            sessions.append(load_session(folder / measured.plan.name, self.arm))
        found = calibrate(sessions, self.arm, Options()).calibration
        self._loaded = save_calibration(folder / "calibration.json", found)
        self.calibration: Calibration = self._loaded.content
        self.causes = list_causes(self.arm, self.calibration)

    def checks(self, history: interim.CheckSeries, seed: int) -> Iterator[Reduced]:
        for measured in interim.measure_checks(history, self.seed, Noise(), seed):
            yield self._reduced(measured)

    def arm_at(self, case: Case, day: float) -> TrueArm:
        """The arm as it is on a day, with as much of the case's happening as is there by then."""
        begun = interim.plan_interim(self.seed, Noise())
        plan = SessionPlan("", 0.0, Climate(), (Visit("P1"),))
        happenings = (case.happening,)
        return interim.plant_happenings(begun, happenings, day, case.used, case.seed, plan).rig.arm

    def advised(self, case: Case, day: int, seats_mm: F64, q: F64) -> Reduced:
        """A check on two seats, poses *q* (n, N) on one and the other in turn, after the usual one
        of a *day*."""
        rng = np.random.default_rng([case.seed, 0xADD, day])
        names = [f"S{i}" for i in range(len(seats_mm))]
        unknown = np.full((len(seats_mm), 3), np.nan)
        artefact = Artefact("advised seats", names, unknown, seats_mm, 0.0, 0.0, 0.0)
        arm = self.arm_at(case, day)
        rig = replace(interim.plan_interim(self.seed, Noise()).rig, arm=arm, artefact=artefact)
        power = SELF_HEATING_W * rng.uniform(0.7, 1.3, len(SELF_HEATING_W))
        climate = Climate(20.0 + float(rng.normal(0.0, 1.5)), power_w=power)
        start_h = interim.FIRST_H + 24.0 * (day - 1) + LATER_H
        plan = SessionPlan(f"day-{day:02}-advised", start_h, climate, interval_s=6.0)
        where = Placement("P1", np.eye(3), np.zeros(3))
        target = np.arange(len(q)) % len(seats_mm)
        measured = take_readings(rig, plan, [where], np.zeros_like(target), target, q, rng)
        return self._reduced(measured)

    def _reduced(self, measured: Measured) -> Reduced:
        where = Path(tempfile.mkdtemp(dir=self.folder)) / measured.plan.name
        write_session(where, measured)
        return reduce(load_session(where, self.arm), self.arm, self.calibration, self.causes)

    def kept(self, checks: Sequence[Reduced]) -> list[Check]:
        """*checks* as a history has them."""
        return [
            Check(
                HistoryLine.model_construct(name=f"day-{i:02}", first_unix_s=check.first_unix_s),
                self.arm,
                self._loaded,
                check,
            )
            for i, check in enumerate(checks, 1)
        ]

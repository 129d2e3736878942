"""A campaign: one true arm, its arm.toml, and the sessions to be measured with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from armd.simulator.measured.artefact import Artefact
from armd.simulator.measured.measuring import Measured, Rig, measure
from armd.simulator.measured.plan import SessionPlan


@dataclass(frozen=True)
class Campaign:
    """What will be measured: the rig as it is, and each session's plan with its artefact."""

    arm_toml: str
    rig: Rig
    sessions: list[tuple[SessionPlan, Artefact]]

    def span_s(self) -> list[tuple[float, float]]:
        """First and last instant of each session, seconds since the arm was mounted."""
        return [
            (
                3600 * plan.start_h,
                3600 * plan.start_h + plan.interval_s * plan.readings(len(artefact.targets)),
            )
            for plan, artefact in self.sessions
        ]

    def carry_out(self, rng: np.random.Generator) -> Iterator[Measured]:
        """Measure session after session."""
        reach = self.rig.reach(rng)
        for plan, artefact in self.sessions:
            yield measure(replace(self.rig, artefact=artefact), plan, reach, rng)

"""The plan of an operator's measurements, and the climate."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.nominal import SELF_HEATING_W

#: When the arm was mounted: the origin of simulated time.
MOUNTED = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)


@dataclass(frozen=True)
class Climate:
    """The air around the arm and the power in it, from `lead_h` before the first reading on.

    Until then the arm stood in air of `ambient_c`, with that power or, if `cold`, switched off.
    """

    ambient_c: float = 20.0
    ramp_k_per_h: float = 0.0
    lead_h: float = 0.0
    power_w: F64 = field(default_factory=lambda: SELF_HEATING_W.copy())  # (N,)
    cold: bool = False

    def air_c(self, time_s: F64) -> F64:
        """Return the air temperature at times since the first reading, s."""
        hours = np.maximum(time_s / 3600 + self.lead_h, 0.0)
        return self.ambient_c + self.ramp_k_per_h * hours


@dataclass(frozen=True)
class Visit:
    """The artefact in one placement: its visited targets, and the articulations of each."""

    name: str
    targets: tuple[str, ...] = ()  # empty: all
    articulations: int = 5
    shoulder_mm: tuple[float, float] = (260.0, 1000.0)  # distances of targets from the shoulder
    radius_mm: tuple[float, float] = (200.0, 1000.0)  # and from the axis of the column


def plan_rounds(placements: int, articulations: int) -> tuple[Visit, ...]:
    """Plan visits of all targets in *placements* different placements."""
    return tuple(Visit(f"P{i + 1}", (), articulations) for i in range(placements))


@dataclass(frozen=True)
class SessionPlan:
    """The plan of one session."""

    name: str
    start_h: float  # since the arm was mounted
    climate: Climate
    visits: tuple[Visit, ...] = plan_rounds(1, 5)
    interval_s: float = 20.0
    rate_rad_s: float = 0.003  # a hand always moves a little; a higher rate: readings in motion
    payload_kg: float = 0.0
    held_out: bool = False  # used only to judge an identification or diagnosis

    @property
    def started(self) -> datetime:
        return MOUNTED + timedelta(hours=self.start_h)

    def readings(self, targets: int) -> int:
        """Return the number of readings on an artefact of so many targets."""
        return sum((len(visit.targets) or targets) * visit.articulations for visit in self.visits)

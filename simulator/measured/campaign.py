"""The data of a campaign: the true arm and instruments, its arm.toml, and the sessions' plans."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field

import numpy as np

from armd.arrays import F64
from armd.simulator.measured.artefact import Artefact
from armd.simulator.measured.electronics import BrownOuts, Restarts
from armd.simulator.measured.noise import Noise
from armd.simulator.measured.plan import SessionPlan
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.rotations import rotate_about

#: Periods per turn of the encoders' interpolation error.
DISC_LINES = 2048


@dataclass(frozen=True)
class Touched:
    """A displacement of the artefact during the first placement of a session."""

    session: str
    share: float  # share of the placement's readings before it
    turn_rad: F64  # (3,) about the middle of the targets
    shift_mm: F64  # (3,)

    def moved(self, points: F64) -> F64:
        """Return points (n, 3) of the artefact after the displacement, base frame, mm."""
        middle = points.mean(axis=0)
        turned: F64 = middle + self.shift_mm + (points - middle) @ rotate_about(self.turn_rad).T
        return turned


@dataclass(frozen=True)
class Rig:
    """The true arm, artefact and instruments."""

    arm: TrueArm
    artefact: Artefact
    noise: Noise
    limits_rad: tuple[F64, F64] = field(default_factory=nominal.get_limits_rad)
    _: KW_ONLY
    core_lag_s: F64 | None = None  # (N,)
    read_sensors: Callable[[F64], F64] = lambda celsius: celsius  # (n, S) true → (n, S) read
    spoil: Callable[[np.random.Generator, int], F64] | None = None  # tip displacement (n, 3) mm
    touched: Touched | None = None
    brown_outs: BrownOuts | None = None
    restarts: Restarts | None = None
    #: how often each posture is read, in succession or in rounds through all of them
    repeats: int = 1
    in_rounds: bool = False
    #: amplitude of the interpolation error: it has as many periods a turn as a disc has lines, so
    #: copies of a posture share it, but no two postures do
    interpolation_rad: float = 0.0

    def interpolation(self, phi: F64) -> F64:
        """Return the interpolation error of encoders at angles (n, N) between two disc lines."""
        joint = np.arange(phi.shape[1])
        error: F64 = self.interpolation_rad * np.sin(DISC_LINES * phi + joint)
        return error


@dataclass(frozen=True)
class Campaign:
    """A campaign: the true rig, and each session's plan with its artefact."""

    arm_toml: str
    rig: Rig
    sessions: list[tuple[SessionPlan, Artefact]]

    def span_s(self) -> list[tuple[float, float]]:
        """Return first and last instant of each session, seconds since the arm was mounted."""
        return [
            (
                3600 * plan.start_h,
                3600 * plan.start_h + plan.interval_s * plan.readings(len(artefact.targets)),
            )
            for plan, artefact in self.sessions
        ]

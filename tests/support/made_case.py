"""A case that the simulator makes, read whole from a folder that is gone afterwards."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armd.arrays import F64
from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.identify.calibrate import calibrate
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import Calibration
from armd.simulator.campaigns.hidden import NOISE, Design
from armd.simulator.hidden import HiddenCase, generate_case
from armd.simulator.measured.noise import Noise
from armd.simulator.plants.plant import Plant


@dataclass(frozen=True)
class MadeCase:
    """The arm and its sessions by their part, and the truth of the case."""

    case: HiddenCase
    arm: Arm
    before: list[Session]
    sessions: list[Session]
    holdout: list[Session]

    def calibrate_before(self) -> Calibration | None:
        """Of the sessions from before the trouble, if there are any."""
        return calibrate(self.before, self.arm).calibration if self.before else None

    def errors_mm(self) -> list[F64]:
        """Of each effect, its exact error (readings, 3) in the sessions to diagnose."""
        names = [path.name for path in self.case.sessions]
        return [np.concatenate([e.error_mm[name] for name in names]) for e in self.case.effects]


def make_case(
    seed: int,
    plants: Sequence[Plant] = (),
    design: Design | None = None,
    noise: Noise = NOISE,
    mess: str = "",
) -> MadeCase:
    """As `generate_case` takes them."""
    with tempfile.TemporaryDirectory() as folder:
        return read_case(generate_case(Path(folder), seed, plants, design, noise, mess))


def read_case(case: HiddenCase) -> MadeCase:
    """A case whose folder is there."""
    arm = load_arm(case.arm)
    before, sessions, holdout = (
        [load_session(path, arm) for path in paths]
        for paths in (case.before, case.sessions, case.holdout)
    )
    return MadeCase(case, arm, before, sessions, holdout)

"""Plants causes in an arm on a wire, which has them from the beginning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.errors import BadInput
from armd.simulator.measured.artefact import make_seat
from armd.simulator.measured.campaign import Campaign, Rig
from armd.simulator.measured.noise import Noise
from armd.simulator.measured.plan import Climate, SessionPlan, plan_rounds
from armd.simulator.plants.causes import plant_all
from armd.simulator.plants.plant import parse_plant
from armd.simulator.truth.arm import TrueArm

#: Causes that begin at an instant begin in a session before the simulation.
BEFORE_H = -24.0


def plant_in_arm(arm: TrueArm, texts: Sequence[str], seed: int) -> TrueArm:
    """Return *arm* with everything of *texts* (`cause@location=size`) in it.

    Raises `BadInput` for a cause that cannot be planted, or is not of the arm itself.
    """
    past = SessionPlan("past", BEFORE_H, Climate(), plan_rounds(1, 5))
    artefact = make_seat()
    campaign = Campaign("", Rig(arm, artefact, Noise()), [(past, artefact)])
    rng = np.random.default_rng([seed, 0x9147])
    for text in texts:
        before = campaign.rig
        campaign = plant_all(campaign, [parse_plant(text)], rng)
        rig = campaign.rig
        surroundings = ("artefact", "noise", "core_lag_s", "read_sensors", "spoil")
        if rig.arm is before.arm or any(
            getattr(rig, name) is not getattr(before, name) for name in surroundings
        ):
            expected = "a cause of the arm itself; others are for --session"
            raise BadInput("--plant", text, "something beside the arm", expected)
    return campaign.rig.arm

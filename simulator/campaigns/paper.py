"""The founding paper's experiment: one ball beam, eight temperatures from 16 to 30 °C.

At each temperature one session for identification and one for validation, in placements of its
own ("heldout-…"). The arm.toml is the arm's earlier calibration at 20 °C, from which it has moved
a little since, so that uncorrected distances err by 70–150 µm at every temperature, as in the
paper's Table 1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armd.simulator.artefact import ball_beam
from armd.simulator.campaigns.campaign import Campaign
from armd.simulator.measuring import Rig
from armd.simulator.noise import Noise
from armd.simulator.plan import Climate, Plan, rounds
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.rotations import ARC_SECOND

TEMPERATURES_C = (16, 18, 20, 22, 24, 26, 28, 30)
#: How far the arm has moved since the calibration that its arm.toml states.
AGED_MM, AGED_ARCSEC = 0.02, 7.0
#: Expansion coefficients grow with temperature: aluminium's by about 1e-8 /K per K.
GROWTH_PER_K2 = 0.8e-8
#: Hours at each temperature before the first reading; a session and its held-out one follow.
STEP_H = 8.0


def campaign(seed: int, noise: Noise) -> Campaign:
    rng = np.random.default_rng([seed, 0x9A9E])
    arm = TrueArm.default(seed)
    n = arm.n_joints
    growth = np.where(arm.materials.along_d + arm.materials.along_a > 0, GROWTH_PER_K2, 0.0)
    arm = replace(arm, materials=replace(arm.materials, growth=growth))
    earlier = arm.rows.copy()
    earlier[:, 1:3] += rng.normal(0.0, AGED_MM, (n, 2))
    earlier[:, [0, 3]] += rng.normal(0.0, AGED_ARCSEC * ARC_SECOND, (n, 2))
    tip = arm.tip_offset + rng.normal(0.0, AGED_MM, 3)
    beam = ball_beam(rng)
    sessions = []
    for i, celsius in enumerate(TEMPERATURES_C):
        climate = Climate(float(celsius))
        plan = Plan(f"T{celsius}", STEP_H * i, climate, rounds(5, 4))
        heldout = Plan(f"heldout-T{celsius}", STEP_H * i + 2.0, climate, rounds(4, 4))
        sessions += [(plan, beam), (heldout, beam)]
    return Campaign(nominal.arm_toml(rows=earlier, tip=tip), Rig(arm, beam, noise), sessions)

"""The 2014 paper's experiment: one ball beam, eight temperatures from 16 to 30 °C.

The paper: *Thermally Induced Errors Modeling and Control for PCMA*, Chinese Optics Letters 12,
S11203. Each temperature has a session for identification and one for validation with its own
placements ("heldout-…"). The arm.toml is the arm's earlier calibration at 20 °C. The arm has
changed a little since, so that uncorrected distances err by 70–150 µm at every temperature, as in
the paper's Table 1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armd.simulator.measured.artefact import Artefact, make_ball_beam
from armd.simulator.measured.campaign import Campaign, Rig
from armd.simulator.measured.measuring import Measured, find_reach, measure
from armd.simulator.measured.noise import Noise
from armd.simulator.measured.plan import Climate, SessionPlan, plan_rounds
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import Materials, TrueArm
from armd.simulator.truth.effects import BendingStylus, EccentricDisc
from armd.simulator.truth.rotations import ARC_SECOND

TEMPERATURES_C = (16, 18, 20, 22, 24, 26, 28, 30)
#: The proportion of changes of lengths and angles since the calibration in arm.toml …
AGED_MM, AGED_ARCSEC = 0.02, 7.0
#: … and their size: the largest error of a distance must be about that of the paper's Table 1 at
#: 20 °C, µm, and within these bounds at the ends and in the middle of its temperatures.
AGED_UM, LEAST_UM, MOST_UM = 100.0, 88.0, 130.0
#: Expansion coefficients grow with temperature: aluminium's by about 1e-8 /K per K.
GROWTH_PER_K2 = 0.8e-8
#: The maker's residual errors: discs centred to 0.04 µm (0.3″) after mapping, and a stylus that
#: bends by 0.5 µm. No thermal model contains either.
LEFT_ECCENTRICITY_UM, LEFT_STYLUS_UM = 0.04, 0.5
#: Hours at each temperature before the first reading; a session and its held-out one follow.
STEP_H = 8.0


def plan_paper(seed: int, noise: Noise) -> Campaign:
    rng = np.random.default_rng([seed, 0x9A9E])
    arm = TrueArm.default(seed)
    n = arm.n_joints
    growth = np.where(arm.materials.along_d + arm.materials.along_a > 0, GROWTH_PER_K2, 0.0)
    arm = replace(arm, materials=replace(arm.materials, growth=growth))
    discs = [
        EccentricDisc(joint, LEFT_ECCENTRICITY_UM, rng.uniform(0, 2 * np.pi))
        for joint in range(1, n + 1)
    ]
    arm = arm.with_effects(*discs, BendingStylus(LEFT_STYLUS_UM))
    beam = make_ball_beam(rng)
    earlier = _before_ageing(arm, beam, rng)
    sessions = []
    for i, celsius in enumerate(TEMPERATURES_C):
        climate = Climate(float(celsius))
        plan = SessionPlan(f"T{celsius}", STEP_H * i, climate, plan_rounds(5, 4))
        heldout = SessionPlan(
            f"heldout-T{celsius}", STEP_H * i + 2.0, climate, plan_rounds(4, 4), held_out=True
        )
        sessions += [(plan, beam), (heldout, beam)]
    text = nominal.make_arm_toml(rows=earlier.rows, tip=earlier.tip_offset)
    return Campaign(text, Rig(arm, beam, noise), sessions)


def _before_ageing(arm: TrueArm, beam: Artefact, rng: np.random.Generator) -> TrueArm:
    """Draw the arm as its maker calibrated it.

    The changes since then are drawn until its distances err like those of the paper's arm.
    """
    rig = Rig(arm, beam, Noise().scaled(0.0))
    reach = find_reach(rig, rng)
    trials = [
        measure(rig, SessionPlan("trial", 0.0, Climate(celsius), plan_rounds(8, 4)), reach, rng)
        for celsius in (16.0, 20.0, 25.0, 30.0)
    ]
    inert = replace(arm, materials=Materials.without_expansion(arm.n_joints))
    n = arm.n_joints
    while True:
        rows = np.zeros((n, 5))
        rows[:, 1:3] = rng.normal(0.0, AGED_MM, (n, 2))
        rows[:, [0, 3]] = rng.normal(0.0, AGED_ARCSEC * ARC_SECOND, (n, 2))
        tip = rng.normal(0.0, AGED_MM, 3)
        share = 1.0
        # Scale in proportion, then again for the part of expansion.
        for _ in range(3):
            then = replace(
                inert, rows=arm.rows + share * rows, tip_offset=arm.tip_offset + share * tip
            )
            errors_um = [1e3 * _largest_change(then, arm, trial) for trial in trials]
            share *= AGED_UM / errors_um[1]
        if min(errors_um) > LEAST_UM and max(errors_um) < MOST_UM:
            return then


def _largest_change(then: TrueArm, now: TrueArm, trial: Measured) -> float:
    """Return the largest difference (mm) of a distance between targets for two arms."""
    balls = len(trial.artefact.targets)
    pairs = np.triu_indices(balls, 1)
    tips = [arm.tip(trial.phi, trial.conditions) for arm in (then, now)]
    largest = 0.0
    for placement in range(len(trial.placements)):
        in_placement = trial.placement == placement
        lengths = []
        for tip in tips:
            mean = np.array(
                [tip[in_placement & (trial.target == k)].mean(axis=0) for k in range(balls)]
            )
            lengths.append(np.linalg.norm(mean[pairs[0]] - mean[pairs[1]], axis=1))
        largest = max(largest, float(np.abs(lengths[0] - lengths[1]).max()))
    return largest

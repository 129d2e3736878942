"""Sessions for a calibration of the demo arm: the ball beam at several temperatures.

The arm is the live simulator's of the same seed, and its arm.toml has nominal values.
"""

from __future__ import annotations

import numpy as np

from armd.simulator.measured.artefact import Artefact, make_ball_beam, make_seat
from armd.simulator.measured.campaign import Campaign, Rig
from armd.simulator.measured.noise import Noise
from armd.simulator.measured.plan import Climate, SessionPlan, Visit, plan_rounds
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.nominal import SELF_HEATING_W

#: A wider range than that of a warm-up by 10 K from a cool or a warm room.
TEMPERATURES_C = (14, 20, 26, 32, 38)
STEP_H = 8.0


def plan_demo(seed: int, noise: Noise) -> Campaign:
    """Plan the sessions of `armd demo`'s calibration: five temperatures, quickly made."""
    plans = [
        SessionPlan(f"T{celsius}", STEP_H * i, Climate(float(celsius)), plan_rounds(3, 3))
        for i, celsius in enumerate(TEMPERATURES_C)
    ]
    return _on_the_beam(seed, noise, plans)


def plan_calibration(seed: int, noise: Noise) -> Campaign:
    """Plan a thorough set: five temperatures, four placements and articulations each."""
    plans = [
        SessionPlan(f"T{celsius}", STEP_H * i, Climate(float(celsius)), plan_rounds(4, 4))
        for i, celsius in enumerate(TEMPERATURES_C)
    ]
    return _on_the_beam(seed, noise, plans)


def plan_isothermal(seed: int, noise: Noise) -> Campaign:
    """Plan two sessions at one temperature: for geometry only."""
    plans = [
        SessionPlan(name, STEP_H * i, Climate(20.0), plan_rounds(4, 4))
        for i, name in enumerate(("first", "second"))
    ]
    return _on_the_beam(seed, noise, plans)


def plan_warm_up(seed: int, noise: Noise) -> Campaign:
    """Plan a warm-up of a cold arm over three hours, then a room warming by 4 K/h."""
    power = 2.5 * SELF_HEATING_W
    plans = [
        SessionPlan(
            "warm-up", 0.0, Climate(20.0, power_w=power, cold=True), plan_rounds(6, 3), 60.0
        ),
        SessionPlan("ramp", 6.0, Climate(20.0, 4.0, 0.5, power), plan_rounds(4, 3), 60.0),
    ]
    return _on_the_beam(seed, noise, plans)


def plan_seats(seed: int, noise: Noise) -> Campaign:
    """Plan kinematic seats at unknown positions, ten articulations each, two temperatures."""
    sessions: list[tuple[SessionPlan, Artefact]] = []
    for i, celsius in enumerate((20, 28)):
        visits = tuple(Visit(f"P{p + 1}", (), 10) for p in range(8))
        sessions.append(
            (SessionPlan(f"T{celsius}", STEP_H * i, Climate(float(celsius)), visits), make_seat())
        )
    return Campaign(
        nominal.make_arm_toml(), Rig(TrueArm.default(seed), make_seat(), noise), sessions
    )


def _on_the_beam(seed: int, noise: Noise, plans: list[SessionPlan]) -> Campaign:
    beam = make_ball_beam(np.random.default_rng([seed, 0xBEA]))
    rig = Rig(TrueArm.default(seed), beam, noise)
    return Campaign(nominal.make_arm_toml(), rig, [(plan, beam) for plan in plans])

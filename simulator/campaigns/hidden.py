"""Designs of measurement for cases that hide an effect."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from armd.simulator.measured.artefact import Artefact, make_ball_frame
from armd.simulator.measured.campaign import Campaign, Rig
from armd.simulator.measured.noise import Noise
from armd.simulator.measured.plan import Climate, SessionPlan, plan_rounds
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import Materials, TrueArm
from armd.simulator.truth.nominal import SELF_HEATING_W

#: Encoders of 1″ and balls known to 2 µm: residuals of about 7 µm RMS.
NOISE = Noise(encoder_arcsec=1.0, seating_um=0.7, sensor_c=0.01)
BALL_UNCERTAINTY_MM = 0.002


@dataclass(frozen=True, kw_only=True)
class Design:
    """The design of a case: sessions of twenty balls with several articulations each."""

    sessions: int = 8
    articulations: int = 5
    celsius: tuple[float, float] = (16.0, 28.0)  # first and last of the sessions' temperatures
    ramp_k_per_h: float = 4.0
    ramps: int = 1  # sessions on that ramp
    heated_links: bool = True  # links warmed individually, differently in each session
    fast_rad_s: float = 0.8  # joint rates in one of the sessions
    slow_rad_s: float = 0.05  # and in the others: readings in motion
    payload_kg: float = 0.0  # in one of the sessions, whose files do not mention it
    certified: bool = True  # False: the balls' positions are unknown
    ranges_deg: dict[int, tuple[float, float]] = field(default_factory=dict)  # by joint
    holdout: int = 2  # further sessions, for the gain
    before: int = 0  # sessions of the healthy arm, for a given calibration
    earlier: Design | None = None  # their design; None: like the others
    levels_c: tuple[float, ...] = ()  # of each session, in order; (): evenly spaced, shuffled
    expanding: bool = True  # False: links and stylus without thermal expansion


DESIGNS: dict[str, Design] = {
    "standard": Design(),
    "calibrated": Design(before=6),
    "few": Design(sessions=4, articulations=3),
    "isothermal": Design(celsius=(20.0, 20.0), ramp_k_per_h=0.0, heated_links=False),
    "static": Design(ramp_k_per_h=0.0, fast_rad_s=0.003, slow_rad_s=0.003),
    "poor": Design(
        celsius=(20.0, 20.0),
        ramp_k_per_h=0.0,
        heated_links=False,
        fast_rad_s=0.003,
        slow_rad_s=0.003,
    ),
    "payload": Design(payload_kg=0.5),
    "ramps": Design(ramp_k_per_h=20.0, ramps=4),
    "short range": Design(ranges_deg={2: (20.0, 95.0), 3: (-125.0, -50.0)}),
    "uncertified": Design(certified=False),
}


def plan_diagnosis(seed: int, noise: Noise) -> Campaign:
    """Plan sessions of the standard design, for `armd diagnose` after a cause was planted."""
    _, later = plan_campaigns(seed, Design(), noise)
    return later


def plan_campaigns(seed: int, design: Design, noise: Noise = NOISE) -> tuple[Campaign, Campaign]:
    """Plan the earlier sessions of the healthy arm, and those to diagnose with the held-out ones.

    Both are of the same arm and artefact; names start with "before", "session" and "holdout".
    """
    rng = np.random.default_rng([seed, 0x41D])
    frame = make_ball_frame(rng, BALL_UNCERTAINTY_MM)
    if not design.certified:
        frame = frame.uncertified()
    low, high = nominal.get_limits_rad()
    for joint, (from_deg, to_deg) in design.ranges_deg.items():
        low[joint - 1], high[joint - 1] = np.radians([from_deg, to_deg])
    arm = TrueArm.default(seed)
    if not design.expanding:
        arm = replace(arm, materials=Materials.without_expansion(arm.n_joints))
    rig = Rig(arm, frame, noise, (low, high))
    before = _plans("before", design.before, 0.0, design.earlier or design, rng)
    later = _plans("session", design.sessions, 400.0, design, rng)
    holdout = _plans("holdout", design.holdout, 400.0 + 4.0 * design.sessions, design, rng)
    text = nominal.make_arm_toml()
    return (
        Campaign(text, rig, _on(frame, before)),
        Campaign(text, rig, _on(frame, later + holdout)),
    )


def _on(frame: Artefact, plans: list[SessionPlan]) -> list[tuple[SessionPlan, Artefact]]:
    return [(plan, frame) for plan in plans]


def _plans(
    name: str, count: int, start_h: float, design: Design, rng: np.random.Generator
) -> list[SessionPlan]:
    """Plan sessions four hours apart: some on a ramp, one fast, one with a payload if any.

    Neither the arm file nor the session states the payload. To the model it is a second error
    beside the planted one, so the standard design has none. Held-out sessions judge the model
    without a payload, as the arm is used.
    """
    celsius = rng.permutation(np.linspace(*design.celsius, max(count, 1)))
    if design.levels_c and name != "holdout":
        celsius = np.resize(design.levels_c, max(count, 1))
    order = rng.permutation(max(count, 3))
    ramped, fast, loaded = order[: design.ramps], order[-1], order[-2]
    held_out = name == "holdout"
    plans = []
    for i in range(count):
        power = SELF_HEATING_W.copy()
        if design.heated_links:
            power *= rng.uniform(0.2, 3.0, len(power))
        ramp = design.ramp_k_per_h if i in ramped else 0.0
        climate = Climate(float(celsius[i]), ramp, 0.5 if ramp else 0.0, power)
        plans.append(
            SessionPlan(
                f"{name}-{i + 1}",
                start_h + 4.0 * i,
                climate,
                plan_rounds(1, design.articulations),
                20.0,
                design.fast_rad_s if i == fast else design.slow_rad_s,
                design.payload_kg if i == loaded and not held_out else 0.0,
                held_out,
            )
        )
    return plans

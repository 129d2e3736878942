"""Makes the imperfections of the arm itself from a plant."""

from __future__ import annotations

import numpy as np

from armd.simulator.measured.campaign import Campaign
from armd.simulator.plants.plant import Plant
from armd.simulator.truth.effects import (
    BowingLink,
    Bristles,
    CablePull,
    CoupledHysteresis,
    CreepingPlay,
    DrivenByRate,
    Effect,
    Interpolation,
    KnockedJoint,
    LettingGo,
    MeshingGears,
    MovingMount,
    RefittedTip,
    SquareWave,
    TrackCurve,
    TwoWheels,
    WarmFromWork,
    WarmHousing,
    WarmNeighbour,
    WideHysteresis,
    WobblingAxis,
)
from armd.simulator.truth.rotations import ARC_SECOND, draw_directions


def draw_angle(plant: Plant, rng: np.random.Generator, name: str = "direction") -> float:
    return float(plant.detail.get(name, rng.uniform(0, 2 * np.pi)))


def draw_instant(plant: Plant, rng: np.random.Generator, campaign: Campaign) -> float:
    """Draw an instant in the middle of a session that is not held out, seconds since mounting."""
    if "instant_s" in plant.detail:
        return float(plant.detail["instant_s"])
    spans = campaign.span_s()
    fitted_spans = [
        span for span, (plan, _) in zip(spans, campaign.sessions, strict=True) if not plan.held_out
    ]
    start, end = fitted_spans[int(rng.integers(len(fitted_spans)))]
    return float(rng.uniform(0.7 * start + 0.3 * end, 0.3 * start + 0.7 * end))


def make_periodic(plant: Plant, rng: np.random.Generator, _: Campaign) -> Effect:
    kind = str(plant.detail.get("kind", "interpolation"))
    order = int(plant.detail.get("order", rng.integers(3, 13)))
    match kind:
        case "interpolation":
            return Interpolation(plant.number, order, plant.size, draw_angle(plant, rng))
        case "square wave":
            return SquareWave(plant.number, order, plant.size, draw_angle(plant, rng))
        case _:
            heights = plant.size * np.array([1.0, -0.7, 0.8]) * rng.uniform(1.0, 1.6, 3)
            centres = draw_angle(plant, rng) + np.array([0.0, 1.7, 3.9]) + rng.uniform(-0.4, 0.4, 3)
            return TrackCurve(plant.number, tuple(heights), tuple(centres), width=0.45)


def make_wobble(plant: Plant, rng: np.random.Generator, _: Campaign) -> Effect:
    """Make a wobble: `kind` "tilt" (size in ″) or "run-out" (size in µm)."""
    order = int(plant.detail.get("order", rng.integers(1, 3)))
    tilt = plant.detail.get("kind", "tilt") == "tilt"
    return WobblingAxis(
        plant.number,
        plant.size if tilt else 0.0,
        0.0 if tilt else plant.size,
        order,
        draw_angle(plant, rng),
        draw_angle(plant, rng, "line"),
    )


def make_knock(plant: Plant, rng: np.random.Generator, campaign: Campaign) -> Effect:
    """Make a knock: `parameter` theta, alpha (size in ″), d or a (size in µm)."""
    parameter = str(plant.detail.get("parameter", rng.choice(["theta", "alpha", "d", "a"])))
    angle, length = plant.size * ARC_SECOND, 1e-3 * plant.size
    still = (0.0, 0.0, 0.0)
    match parameter:
        case "theta":
            return KnockedJoint(plant.number, (0.0, 0.0, angle), still)
        case "alpha":
            return KnockedJoint(plant.number, (angle, 0.0, 0.0), still)
        case "d":
            return KnockedJoint(plant.number, still, (0.0, 0.0, length))
        case _:
            return KnockedJoint(plant.number, still, (length, 0.0, 0.0))


def make_bow(plant: Plant, rng: np.random.Generator, campaign: Campaign) -> Effect:
    link = plant.number
    neighbour = link + 1 if link < campaign.rig.arm.n_joints else link - 1
    neighbour = int(plant.detail.get("neighbour", neighbour))
    return BowingLink(link, neighbour, 1e-6 * plant.size, draw_angle(plant, rng))


def make_warm(plant: Plant, rng: np.random.Generator, _: Campaign) -> Effect:
    """Make a warm housing: `order` 1: ″/K; 2: ″/K²."""
    if int(plant.detail.get("order", 1)) == 2:
        return WarmHousing(plant.number, 0.0, plant.size)
    return WarmHousing(plant.number, plant.size)


def plant_mount(plant: Plant, rng: np.random.Generator, campaign: Campaign) -> Effect:
    """Make a moving mount.

    `kind` "drift" (size × 3″ and 5 µm an hour) or "step" (size × 4″ and 5 µm at once).
    """
    step = plant.detail.get("kind", "drift") == "step"
    turn = plant.size * (4.0 if step else 3.0) * draw_directions(rng, 1)[0]
    shift = plant.size * 5.0 * draw_directions(rng, 1)[0]
    since = campaign.span_s()[0][0]
    instant_s = draw_instant(plant, rng, campaign) if step else None
    return MovingMount(tuple(turn), tuple(shift), since, instant_s)


def make_tip_change(plant: Plant, rng: np.random.Generator, campaign: Campaign) -> Effect:
    """Make a moved tip: `kind` "refit" (from an instant on) or "once" (from the start)."""
    shift = tuple(plant.size * draw_directions(rng, 1)[0])
    if plant.detail.get("kind", "refit") == "once":
        return RefittedTip(shift)
    return RefittedTip(shift, draw_instant(plant, rng, campaign))


def make_gear_mesh(plant: Plant, rng: np.random.Generator, campaign: Campaign) -> Effect:
    """Make a gear mesh.

    `other`: the joint that drives it (a neighbour); `waves`: per turn of that joint; `ratio`: the
    share of its own angle.
    """
    neighbours = [k for k in (plant.number - 1, plant.number + 1) if k >= 1]
    neighbours = [k for k in neighbours if k <= campaign.rig.arm.n_joints]
    other_joint = int(plant.detail.get("other", rng.choice(neighbours)))
    waves = int(plant.detail.get("waves", rng.integers(1, 13)))
    ratio = float(plant.detail.get("ratio", rng.choice([-1.0, 0.0, 0.0, 1.0])))
    return MeshingGears(plant.number, other_joint, waves, plant.size, draw_angle(plant, rng), ratio)


def make_work(plant: Plant, rng: np.random.Generator, _: Campaign) -> Effect:
    """Make self-heating: `parameter` "theta" (size in ″ at 1 rad/s) or "length" (size × 4 ppm).

    `time_constant_s` is its time constant.
    """
    lag_s = float(
        plant.detail.get("time_constant_s", np.exp(rng.uniform(np.log(120), np.log(900))))
    )
    if plant.detail.get("parameter", "theta") == "theta":
        return WarmFromWork(plant.number, plant.size, 0.0, lag_s)
    return WarmFromWork(plant.number, 0.0, 4.0 * plant.size, lag_s)


def make_unknown(plant: Plant, rng: np.random.Generator, campaign: Campaign) -> Effect:
    """Make an effect of no catalogue, by its `kind`; `joint` and `other` are its places."""
    joint = int(plant.detail.get("joint", 2))
    other_joint = int(plant.detail.get("other", 3))
    match str(plant.detail.get("kind", "cable")):
        case "cable":
            return CablePull(joint, other_joint, plant.size)
        case "hysteresis":
            return CoupledHysteresis(joint, other_joint, plant.size)
        case "wear":
            return CreepingPlay(joint, plant.size, campaign.span_s()[0][0])
        case "bristles":
            return Bristles(joint, plant.size, float(plant.detail.get("within_rad", 0.05)))
        case "letting go":
            return LettingGo(joint, plant.size)
        case "wide hysteresis":
            return WideHysteresis(joint, plant.size, float(rng.uniform(0.8, 2.0)))
        case "two wheels":
            waves, other_waves = (int(n) for n in rng.integers(2, 6, 2))
            return TwoWheels(
                joint, other_joint, waves, other_waves, plant.size, draw_angle(plant, rng)
            )
        case "warm neighbour":
            return WarmNeighbour(joint, other_joint, plant.size, float(rng.uniform(300.0, 1200.0)))
        case _:
            return DrivenByRate(joint, plant.size)

"""Plants causes in a campaign: a fault, its size and its place.

The table `CAUSES` has one line per cause of `armd diagnose`; each plants its own physics
(`truth/effects/`), of a size in the cause's unit. "unknown" plants effects of no catalogue.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from armd.errors import BadInput
from armd.simulator.measured.campaign import Campaign
from armd.simulator.plants import arm, surroundings
from armd.simulator.plants.drift import is_drift, make_drifting
from armd.simulator.plants.plant import Plant
from armd.simulator.truth.effects import (
    BendingLink,
    BendingStylus,
    Distorted,
    EccentricDisc,
    Effect,
    ExpandingLink,
    LateLatch,
    LostIndex,
    OvalDisc,
    Play,
    SaggingStylus,
    SoftJoint,
    StretchedTape,
    WarmDisc,
)
from armd.simulator.truth.nominal import list_sensor_names
from armd.terminal.suggest import format_names, suggest

How = Callable[[Campaign, Plant, np.random.Generator], Campaign]
MakeEffect = Callable[[Plant, np.random.Generator, Campaign], Effect]


@dataclass(frozen=True)
class Planting:
    """A recipe to plant a cause: `plant` gets the campaign, the plant, and a generator."""

    unit: str
    typical: float
    places: str  # "joint", "link", "sensor", "sensors", "target", or the location itself
    plant: How


def plant_imperfection(make: MakeEffect) -> How:
    """Return a function that plants an imperfection of the arm itself."""

    def plant(campaign: Campaign, planned: Plant, rng: np.random.Generator) -> Campaign:
        imperfect = campaign.rig.arm
        effect = make(planned, rng, campaign)
        if share := float(planned.detail.get("distortion", 0.0)):
            joint = planned.number if planned.location[-1].isdigit() else imperfect.n_joints - 1
            effect = Distorted(
                effect, share, joint, arm.draw_angle(planned, rng, "distortion phase")
            )
        imperfect = imperfect.with_effects(*imperfect.effects, effect)
        return replace(campaign, rig=replace(campaign.rig, arm=imperfect))

    return plant


def allow_drift(make: MakeEffect) -> MakeEffect:
    """Return a function like *make* that makes a drift if the plant has a course."""

    def either(plant: Plant, rng: np.random.Generator, campaign: Campaign) -> Effect:
        return (make_drifting if is_drift(plant) else make)(plant, rng, campaign)

    return either


def plant_all(campaign: Campaign, plants: Sequence[Plant], rng: np.random.Generator) -> Campaign:
    """Return the campaign with all *plants*; raises `BadInput` for one that cannot be planted."""
    for plant in plants:
        if plant.cause not in CAUSES:
            suggestion = suggest(plant.cause, CAUSES)
            expected = f"a cause{suggestion}" if suggestion else f"one of {', '.join(CAUSES)}"
            raise BadInput("--plant", plant.cause, "an unknown cause", expected)
        _check_location(campaign, plant)
        campaign = CAUSES[plant.cause].plant(campaign, plant, rng)
    return campaign


def _check_location(campaign: Campaign, plant: Plant) -> None:
    n = campaign.rig.arm.n_joints
    joints, sensors = range(1, n + 1), list_sensor_names(n)
    places = CAUSES[plant.cause].places
    match places:
        case "joint" | "link":
            locations = [f"{places} {k}" for k in joints]
        case "sensor":
            locations = [f"sensor {name}" for name in sensors]
        case "sensors":
            locations = [f"sensors {a}, {b}" for a, b in combinations(sensors, 2)]
        case "target":
            locations = ["artefact", *(f"target {name}" for name in campaign.rig.artefact.targets)]
        case _:
            locations = [places]
    if plant.location not in locations:
        same = [name for name in locations if _bare(name) == _bare(plant.location)]
        expected = f"{same[0]!r}" if same else format_names(locations)
        raise BadInput("--plant", plant.cause, f"location {plant.location!r}", expected)


def _bare(location: str) -> str:
    return location.replace(" ", "").replace("_", "").lower()


CAUSES: dict[str, Planting] = {
    "encoder_eccentricity": Planting(
        "µm",
        0.73,
        "joint",
        plant_imperfection(lambda p, r, _: EccentricDisc(p.number, p.size, arm.draw_angle(p, r))),
    ),
    "encoder_ellipticity": Planting(
        "″",
        3.0,
        "joint",
        plant_imperfection(lambda p, r, _: OvalDisc(p.number, p.size, arm.draw_angle(p, r))),
    ),
    "encoder_periodic": Planting("″", 2.0, "joint", plant_imperfection(arm.make_periodic)),
    "encoder_scale": Planting(
        "″/rad", 5.0, "joint", plant_imperfection(lambda p, _r, _: StretchedTape(p.number, p.size))
    ),
    "encoder_slip": Planting(
        "″",
        15.0,
        "joint",
        plant_imperfection(lambda p, r, c: LostIndex(p.number, p.size, arm.draw_instant(p, r, c))),
    ),
    "joint_backlash": Planting(
        "″", 2.0, "joint", plant_imperfection(lambda p, _r, _: Play(p.number, p.size))
    ),
    "encoder_thermal": Planting(
        "µm/K",
        0.15,
        "joint",
        plant_imperfection(lambda p, r, _: WarmDisc(p.number, p.size, arm.draw_angle(p, r))),
    ),
    "gear_mesh": Planting("″", 3.0, "joint", plant_imperfection(arm.make_gear_mesh)),
    "self_heating": Planting("″ at 1 rad/s", 20.0, "joint", plant_imperfection(arm.make_work)),
    "axis_wobble": Planting("″", 3.0, "joint", plant_imperfection(arm.make_wobble)),
    "joint_compliance": Planting(
        "µrad/Nm",
        6.0,
        "joint",
        plant_imperfection(lambda p, _r, _: SoftJoint(p.number, 1e-6 * p.size)),
    ),
    "link_bending": Planting(
        "µrad/Nm",
        8.0,
        "link",
        plant_imperfection(lambda p, _r, _: BendingLink(p.number, 1e-6 * p.size)),
    ),
    "probing_force": Planting(
        "µm", 15.0, "tip", plant_imperfection(lambda p, _r, _: BendingStylus(p.size))
    ),
    "stylus_sag": Planting(
        "µm", 15.0, "tip", plant_imperfection(lambda p, _r, _: SaggingStylus(p.size))
    ),
    "link_expansion": Planting(
        "ppm/K",
        10.0,
        "link",
        plant_imperfection(lambda p, _r, _: ExpandingLink(p.number, 1e-6 * p.size)),
    ),
    "nonlinear_expansion": Planting(
        "ppm/K²",
        0.08,
        "link",
        plant_imperfection(lambda p, _r, _: ExpandingLink(p.number, 0.0, 1e-6 * p.size)),
    ),
    "thermal_lag": Planting("s", 900.0, "link", surroundings.plant_lag),
    "thermal_gradient": Planting("µrad/m/K", 120.0, "link", plant_imperfection(arm.make_bow)),
    "geometry_shift": Planting(
        "″ or µm", 15.0, "joint", plant_imperfection(allow_drift(arm.make_knock))
    ),
    "joint_thermal": Planting("″/K", 0.5, "joint", plant_imperfection(arm.make_warm)),
    "sensor_offset": Planting("K", 1.0, "sensor", surroundings.plant_sensor_offset),
    "sensor_swapped": Planting("-", 1.0, "sensors", surroundings.plant_sensor_swap),
    "artefact_expansion": Planting("ppm/K", 2.5, "artefact", surroundings.plant_artefact_expansion),
    "artefact_length": Planting("µm", 10.0, "target", surroundings.plant_artefact_length),
    "artefact_sag": Planting("µm", 15.0, "artefact", surroundings.plant_artefact_sag),
    "time_skew": Planting(
        "µs", 80.0, "joint", plant_imperfection(lambda p, _r, _: LateLatch(p.number, p.size))
    ),
    "mount_drift": Planting("×", 1.0, "base", plant_imperfection(allow_drift(arm.plant_mount))),
    "tip_offset": Planting("µm", 7.0, "tip", plant_imperfection(arm.make_tip_change)),
    "outliers": Planting("µm", 60.0, "rows", surroundings.plant_outliers),
    "unknown": Planting("by kind", 5.0, "-", plant_imperfection(arm.make_unknown)),
}

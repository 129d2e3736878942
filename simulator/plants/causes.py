"""Planting causes in a campaign: what is wrong, how much, and where.

The table `CAUSES` has one line per cause of `armd diagnose`; each plants physics of its own
(`truth/effects/`), of a size in the cause's unit. "unknown" plants what no catalogue has.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from armd.errors import BadInput
from armd.simulator.measured.campaign import Campaign
from armd.simulator.plants import arm, surroundings
from armd.simulator.plants.plant import Cause, Plant
from armd.simulator.truth.effects import (
    BendingLink,
    BendingStylus,
    EccentricDisc,
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
from armd.simulator.truth.nominal import sensor_names
from armd.terminal.suggest import did_you_mean, few


def plant_all(campaign: Campaign, plants: Sequence[Plant], rng: np.random.Generator) -> Campaign:
    """The campaign with all *plants* in it; raises `BadInput` for what cannot be planted."""
    for plant in plants:
        if plant.cause not in CAUSES:
            near = did_you_mean(plant.cause, CAUSES)
            expected = f"a cause{near}" if near else f"one of {', '.join(CAUSES)}"
            raise BadInput("--plant", plant.cause, "an unknown cause", expected)
        _check_location(campaign, plant)
        campaign = CAUSES[plant.cause].plant(campaign, plant, rng)
    return campaign


def _check_location(campaign: Campaign, plant: Plant) -> None:
    n = campaign.rig.arm.n_joints
    joints, sensors = range(1, n + 1), sensor_names(n)
    places = CAUSES[plant.cause].places
    match places:
        case "joint" | "link":
            known = [f"{places} {k}" for k in joints]
        case "sensor":
            known = [f"sensor {name}" for name in sensors]
        case "sensors":
            known = [f"sensors {a}, {b}" for a, b in combinations(sensors, 2)]
        case "target":
            known = ["artefact", *(f"target {name}" for name in campaign.rig.artefact.targets)]
        case _:
            known = [places]
    if plant.location not in known:
        same = [name for name in known if _bare(name) == _bare(plant.location)]
        expected = f"{same[0]!r}" if same else few(known)
        raise BadInput("--plant", plant.cause, f"location {plant.location!r}", expected)


def _bare(location: str) -> str:
    return location.replace(" ", "").replace("_", "").lower()


CAUSES: dict[str, Cause] = {
    "encoder_eccentricity": Cause(
        "µm",
        0.73,
        "joint",
        arm.imperfection(lambda p, r, _: EccentricDisc(p.number, p.size, arm.angle(p, r))),
    ),
    "encoder_ellipticity": Cause(
        "″",
        3.0,
        "joint",
        arm.imperfection(lambda p, r, _: OvalDisc(p.number, p.size, arm.angle(p, r))),
    ),
    "encoder_periodic": Cause("″", 2.0, "joint", arm.imperfection(arm.periodic)),
    "encoder_scale": Cause(
        "″/rad", 5.0, "joint", arm.imperfection(lambda p, _r, _: StretchedTape(p.number, p.size))
    ),
    "encoder_slip": Cause(
        "″",
        15.0,
        "joint",
        arm.imperfection(lambda p, r, c: LostIndex(p.number, p.size, arm.instant(p, r, c))),
    ),
    "joint_backlash": Cause(
        "″", 2.0, "joint", arm.imperfection(lambda p, _r, _: Play(p.number, p.size))
    ),
    "encoder_thermal": Cause(
        "µm/K",
        0.15,
        "joint",
        arm.imperfection(lambda p, r, _: WarmDisc(p.number, p.size, arm.angle(p, r))),
    ),
    "gear_mesh": Cause("″", 3.0, "joint", arm.imperfection(arm.mesh)),
    "self_heating": Cause("″ at 1 rad/s", 20.0, "joint", arm.imperfection(arm.work)),
    "axis_wobble": Cause("″", 3.0, "joint", arm.imperfection(arm.wobble)),
    "joint_compliance": Cause(
        "µrad/Nm",
        6.0,
        "joint",
        arm.imperfection(lambda p, _r, _: SoftJoint(p.number, 1e-6 * p.size)),
    ),
    "link_bending": Cause(
        "µrad/Nm",
        8.0,
        "link",
        arm.imperfection(lambda p, _r, _: BendingLink(p.number, 1e-6 * p.size)),
    ),
    "probing_force": Cause(
        "µm", 15.0, "tip", arm.imperfection(lambda p, _r, _: BendingStylus(p.size))
    ),
    "stylus_sag": Cause(
        "µm", 15.0, "tip", arm.imperfection(lambda p, _r, _: SaggingStylus(p.size))
    ),
    "link_expansion": Cause(
        "ppm/K",
        10.0,
        "link",
        arm.imperfection(lambda p, _r, _: ExpandingLink(p.number, 1e-6 * p.size)),
    ),
    "nonlinear_expansion": Cause(
        "ppm/K²",
        0.08,
        "link",
        arm.imperfection(lambda p, _r, _: ExpandingLink(p.number, 0.0, 1e-6 * p.size)),
    ),
    "thermal_lag": Cause("s", 900.0, "link", surroundings.lag),
    "thermal_gradient": Cause("µrad/m/K", 120.0, "link", arm.imperfection(arm.bow)),
    "geometry_shift": Cause("″ or µm", 15.0, "joint", arm.imperfection(arm.knock)),
    "joint_thermal": Cause("″/K", 0.5, "joint", arm.imperfection(arm.warm)),
    "sensor_offset": Cause("K", 1.0, "sensor", surroundings.sensor_offset),
    "sensor_swapped": Cause("-", 1.0, "sensors", surroundings.sensor_swap),
    "artefact_expansion": Cause("ppm/K", 2.5, "artefact", surroundings.artefact_expansion),
    "artefact_length": Cause("µm", 10.0, "target", surroundings.artefact_length),
    "artefact_sag": Cause("µm", 15.0, "artefact", surroundings.artefact_sag),
    "time_skew": Cause(
        "µs", 80.0, "joint", arm.imperfection(lambda p, _r, _: LateLatch(p.number, p.size))
    ),
    "mount_drift": Cause("×", 1.0, "base", arm.imperfection(arm.mount)),
    "tip_offset": Cause("µm", 7.0, "tip", arm.imperfection(arm.tip)),
    "outliers": Cause("µm", 60.0, "rows", surroundings.outliers),
    "unknown": Cause("by kind", 5.0, "-", arm.imperfection(arm.unknown)),
}

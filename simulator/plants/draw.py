"""Draws causes at random, at places where physics makes them visible."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.simulator.plants.causes import CAUSES
from armd.simulator.plants.plant import Plant
from armd.simulator.truth.nominal import list_sensor_names

#: Joints whose angle error cannot be absorbed by the mount or the tip. The mount absorbs the first
#: joint's constant and the tip the last one's, but not their harmonics.
JOINTS = (1, 2, 3, 4, 5, 6)
#: Long links, which bend, bow and expand.
LINKS = (2, 4)
#: Joints that carry weight across their axis in most poses.
LOADED = (2, 3)
#: Joints whose knock neither the mount nor the tip absorbs.
KNOCKED = (2, 3, 4, 5)
#: Links with enough length for a wrong temperature to matter.
WARM = (1, 2, 4)

#: Typical sizes of the foreign kinds, in ″/rad², ″, ″/(rad/s)², ″/h, ″.
FOREIGN_SIZE = {
    "cable": 6.0,
    "hysteresis": 6.0,
    "drag": 40.0,
    "wear": 0.3,
    "bristles": 3.0,
}
FOREIGN = tuple(FOREIGN_SIZE)


def draw_plant(rng: np.random.Generator, causes: Sequence[str] = (), factor: float = 1.0) -> Plant:
    """Draw one plant of a cause out of *causes* (all but "unknown" if empty).

    Its size is the typical one × *factor* × a log-normal factor of ±40 %, of either sign where the
    sign has a meaning.
    """
    choices = causes or [cause for cause in CAUSES if cause != "unknown"]
    cause = str(rng.choice(choices))
    size = factor * float(np.exp(rng.normal(0.0, 0.4)))
    if cause == "unknown":
        return _foreign(rng, size)
    size *= CAUSES[cause].typical
    if cause in ("encoder_scale", "encoder_slip", "link_expansion", "sensor_offset", "time_skew"):
        size *= float(rng.choice([-1.0, 1.0]))
    detail: dict[str, float | str] = {}
    match cause:
        case "axis_wobble" if rng.uniform() < 0.3:
            detail, size = {"kind": "run-out"}, size * 5.0 / 3.0
        case "geometry_shift":
            parameter = str(rng.choice(["theta", "alpha", "d", "a"]))
            detail = {"parameter": parameter}
            size *= 2.0 if parameter in "da" else 1.0
            if parameter == "d":
                # Along parallel axes, shifts of two joints are the same.
                return Plant(cause, f"joint {rng.choice([4, 5])}", size, detail)
        case "self_heating":
            detail = {"parameter": "theta"}
        case "mount_drift":
            detail = {"kind": str(rng.choice(["drift", "step"]))}
    return Plant(cause, _place(rng, cause), size, detail)


def _place(rng: np.random.Generator, cause: str) -> str:
    places = CAUSES[cause].places
    match places:
        case "joint":
            joints = {"joint_compliance": LOADED, "geometry_shift": KNOCKED}.get(cause, JOINTS)
            if cause in ("encoder_scale", "joint_thermal", "axis_wobble", "self_heating"):
                # The tip's few mm make a gain or tilt of the last joints invisible.
                joints = (2, 3, 4, 5) if cause != "axis_wobble" else (1, 2, 3, 4)
            return f"joint {rng.choice(joints)}"
        case "link":
            return f"link {rng.choice(LINKS)}"
        case "sensor":
            return f"sensor t{rng.choice(WARM[1:])}"
        case "sensors":
            a, b = sorted(rng.choice(len(list_sensor_names()), 2, replace=False) + 1)
            return f"sensors t{a}, t{b}"
        case "target":
            return f"target B{rng.integers(1, 21)}"
    return places


def _foreign(rng: np.random.Generator, size: float) -> Plant:
    kind = str(rng.choice(FOREIGN))
    joint, other_joint = (int(j) for j in rng.choice([1, 2, 3, 4], 2, replace=False))
    detail: dict[str, float | str] = {"kind": kind, "joint": joint, "other": other_joint}
    return Plant("unknown", "-", size * FOREIGN_SIZE[kind], detail)

"""Plants drifts: of a zero, a length, a twist or the mount, along a course in time.

A plant drifts if its `detail` has a `course`: "creeping", "relaxing", "swelling", "daily" or
"wandering". Its size is the final amount: for a mount × 4″ and 5 µm.
"""

from __future__ import annotations

import numpy as np

from armd.simulator.measured.campaign import Campaign
from armd.simulator.plants.plant import Plant
from armd.simulator.truth import course
from armd.simulator.truth.course import CourseInTime
from armd.simulator.truth.effects import (
    DriftingLength,
    DriftingMount,
    DriftingTwist,
    DriftingZero,
    Effect,
)
from armd.simulator.truth.rotations import draw_directions

COURSES = ("creeping", "relaxing", "swelling", "daily", "wandering")
#: Typical sizes by parameter: ″ of a zero or twist, ppm of a length.
DRIFT_SIZE = {"theta": 12.0, "alpha": 15.0, "a": 40.0, "d": 40.0}
#: Joints whose zero neither mount nor tip absorbs; links long enough to show a strain.
ZEROS, LONG, TWISTED = (2, 3, 4, 5), {"a": (2,), "d": (4,)}, (2, 3, 4)
MOUNT_SIZE = 8.0  # × 4″ and 5 µm: only motion within a placement shows


def is_drift(plant: Plant) -> bool:
    return "course" in plant.detail


def make_drifting(plant: Plant, rng: np.random.Generator, campaign: Campaign) -> Effect:
    """Make the effect of a plant with a course."""
    along = _course(str(plant.detail["course"]), plant, rng, campaign)
    if plant.cause == "mount_drift":
        turn, shift = (
            tuple(plant.size * amplitude * draw_directions(rng, 1)[0]) for amplitude in (4.0, 5.0)
        )
        return DriftingMount(turn, shift, along)
    match plant.detail["parameter"]:
        case "theta":
            return DriftingZero(plant.number, plant.size, along)
        case "alpha":
            return DriftingTwist(plant.number, (plant.size, 0.0, 0.0), along)
        case _:
            return DriftingLength(plant.number, plant.size, along)


def _course(kind: str, plant: Plant, rng: np.random.Generator, campaign: Campaign) -> CourseInTime:
    spans = [
        span
        for span, (plan, _) in zip(campaign.span_s(), campaign.sessions, strict=True)
        if not plan.held_out
    ]
    since, until = spans[0][0], spans[-1][1]
    span = until - since
    match kind:
        case "creeping":
            return course.make_creeping(since, until)
        case "relaxing":
            # A mount must settle within a session, or nothing of it is visible.
            longest = spans[0][1] - since if plant.cause == "mount_drift" else span
            return course.make_relaxing(since, longest * float(rng.uniform(0.15, 0.5)))
        case "swelling":
            return course.make_swelling(since - 1800.0, span * float(rng.uniform(0.3, 1.0)))
        case "daily":
            return course.make_daily(since + course.DAY_S * float(rng.uniform()))
        case _:
            return course.draw_wandering(rng, since, until)


def draw_drift(rng: np.random.Generator) -> Plant:
    """Draw one drifting plant, of typical size × a log-normal factor of ±40 %, either sign."""
    kind = str(rng.choice(COURSES))
    size = float(np.exp(rng.normal(0.0, 0.4)) * rng.choice([-1.0, 1.0]))
    parameter = str(rng.choice([*DRIFT_SIZE, "mount"]))
    if parameter == "mount":
        return Plant("mount_drift", "base", MOUNT_SIZE * size, {"course": kind})
    places = {"theta": ZEROS, "alpha": TWISTED, **LONG}[parameter]
    detail: dict[str, float | str] = {"course": kind, "parameter": parameter}
    joint = int(rng.choice(places))
    return Plant("geometry_shift", f"joint {joint}", DRIFT_SIZE[parameter] * size, detail)

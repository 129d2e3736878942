"""A joint's angle (or its axis) changes with temperature."""

from collections.abc import Iterator

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    Effect,
    SessionFacts,
    make_temperature,
    tie,
)
from armd.compensation.wording import ARC_SECOND, seconds_of_arc

#: typical size by order; a square, because a housing under preload moves in a curve
TYPICAL_RAD = {1: 0.6 * ARC_SECOND, 2: 0.06 * ARC_SECOND}


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        own_weights = facts.weights(k)
        for weights in [own_weights] if own_weights else [{name: 1.0} for name in facts.sensors]:
            for name in ("theta", "alpha", "beta"):
                for order, prior_sd in TYPICAL_RAD.items():
                    factor = make_temperature(weights, order=order)
                    unit = "rad/K" if order == 1 else f"rad/K^{order}"
                    column = Column(name, unit, prior_sd, tie([(f"{name}_{k}", 1.0)], factor))
                    setting = (("order", float(order), "1"),)
                    place = location.joint(k)
                    yield Candidate("joint_thermal", place, (column,), tuple(weights), setting)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    order = int(candidate.setting[0][1])
    angle = amplitudes[0] * 5.0**order
    return (
        f"{candidate.columns[0].name} of {candidate.location} moves by {seconds_of_arc(angle)} "
        "at 5 K from the reference"
    )


EFFECT = Effect(
    "joint_thermal",
    "housing and encoder mount expand unevenly and turn the zero or the axis",
    "bending of the link by a gradient",
    "measure the same poses at two more temperatures",
    list_candidates,
    describe,
    "temperatures that vary over the readings",
    by_temperature=True,
)

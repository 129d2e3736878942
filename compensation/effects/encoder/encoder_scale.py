"""The gain of an angle is wrong."""

from collections.abc import Iterator

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts, tie
from armd.compensation.model.pose_factors import Angle
from armd.compensation.wording import ARC_SECOND, seconds_of_arc


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        terms = tie([(f"theta_{k}", 1.0)], Angle(joint=k))
        column = Column("gain", "rad/rad", 5 * ARC_SECOND, terms)
        yield Candidate("encoder_scale", location.joint(k), (column,), (f"q{k}",))


def describe(candidate: Candidate, amplitudes: F64) -> str:
    return f"{candidate.location} shows {seconds_of_arc(amplitudes[0])} per radian too much or less"


EFFECT = Effect(
    "encoder_scale",
    "a gear ratio, a count per turn or a linearised sensor with a wrong gain",
    "eccentricity where the joint turns less than 150°",
    "use the joint's whole range, over 150°",
    list_candidates,
    describe,
    as_coarse_as_the_arm=True,
)

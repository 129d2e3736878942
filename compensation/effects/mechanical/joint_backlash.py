"""The angle lags behind, to the side from which the joint came."""

from collections.abc import Iterator

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts, tie
from armd.compensation.model.pose_factors import Side
from armd.compensation.wording import ARC_SECOND, seconds_of_arc


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    if not facts.rates:
        return
    for k in facts.joints:
        terms = tie([(f"theta_{k}", 1.0)], Side(joint=k))
        column = Column("half width", "rad", 2 * ARC_SECOND, terms)
        yield Candidate("joint_backlash", location.joint(k), (column,), (f"w{k}",))


def describe(candidate: Candidate, amplitudes: F64) -> str:
    return f"{candidate.location} has {seconds_of_arc(2 * amplitudes[0])} of play between its sides"


EFFECT = Effect(
    "joint_backlash",
    "play or friction between encoder and link: the error depends on the side of approach",
    "an angle that is late (time skew), when rates differ little",
    "measure the same poses from both sides of each joint",
    list_candidates,
    describe,
    "joint rates at the readings (w1, w2, …): their signs tell the side from which each joint came",
    by_motion=True,
    as_coarse_as_the_arm=True,
)

"""A joint's angle is latched late."""

from collections.abc import Iterator

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts, tie
from armd.compensation.model.pose_factors import Rate
from armd.compensation.wording import format_plain


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    if not facts.rates:
        return
    for k in facts.joints:
        terms = tie([(f"theta_{k}", 1.0)], Rate(joint=k))
        column = Column("delay", "s", 80e-6, terms)
        yield Candidate("time_skew", location.joint(k), (column,), (f"w{k}",))


def describe(candidate: Candidate, amplitudes: F64) -> str:
    delay_us = format_plain(abs(amplitudes[0]) * 1e6)
    return f"the angle of {candidate.location} is {delay_us} µs out of step"


EFFECT = Effect(
    "time_skew",
    "one encoder is latched earlier or later: its error is proportional to its rate",
    "backlash, when all rates are alike",
    "measure one target in motion, slowly and fast",
    list_candidates,
    describe,
    "joint rates at the readings (w1, w2, …), some of them taken in motion",
    by_motion=True,
)

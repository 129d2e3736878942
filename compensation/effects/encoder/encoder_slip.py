"""A joint's index is lost: its angle steps at a moment and stays so."""

from collections.abc import Iterator

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import (
    ARC_SECOND,
    Candidate,
    Column,
    Effect,
    SessionFacts,
    seconds_of_arc,
    tie,
    when,
)
from armd.compensation.model.slow_factors import After


def _at(facts: SessionFacts, joint: int, instant: float, finest: bool) -> Candidate:
    terms = tie([(f"theta_{joint}", 1.0)], After(instant_unix_s=instant))
    column = Column("step", "rad", 15 * ARC_SECOND, terms)

    def refine() -> list[Candidate]:
        return [_at(facts, joint, t, True) for t in facts.nearby_instants(instant)]

    return Candidate(
        "encoder_slip",
        location.joint(joint),
        (column,),
        ("time_s",),
        (("instant", instant, "s (Unix)"),),
        None if finest else refine,
    )


def candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        for instant in facts.instants_unix_s:
            yield _at(facts, k, instant, False)


def reading(candidate: Candidate, amplitudes: F64) -> str:
    size = seconds_of_arc(amplitudes[0])
    return f"the index of {candidate.location} slipped by {size}{when(candidate)}"


EFFECT = Effect(
    "encoder_slip",
    "the disc or its hub slipped on the shaft, or counts were lost",
    "drift of the base, for joint 1",
    "repeat a few poses measured before the moment named",
    candidates,
    reading,
    "the time of each reading (time_s)",
    accident=True,
    by_motion=True,
)

"""A joint loses its index: its angle steps at a moment and stays so."""

from collections.abc import Iterator
from functools import partial

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.courses import make_steps
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    Effect,
    SessionFacts,
    describe_instant,
    tie,
)
from armd.compensation.model.slow_factors import After
from armd.compensation.wording import ARC_SECOND, seconds_of_arc


def make_columns(joint: int, *basis: After) -> tuple[Column]:
    """Make the column of a step of a joint's angle, from an instant on or at all times."""
    return (Column("step", "rad", 15 * ARC_SECOND, tie([(f"theta_{joint}", 1.0)], *basis)),)


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        yield from make_steps(facts, "encoder_slip", location.joint(k), partial(make_columns, k))


def describe(candidate: Candidate, amplitudes: F64) -> str:
    size = seconds_of_arc(amplitudes[0])
    return f"the index of {candidate.location} slipped by {size}{describe_instant(candidate)}"


EFFECT = Effect(
    "encoder_slip",
    "the disc or its hub slipped on the shaft, or counts were lost",
    "drift of the base, for joint 1",
    "repeat a few poses from before the named moment",
    list_candidates,
    describe,
    "the time of each reading (time_s)",
    accident=True,
    by_motion=True,
)

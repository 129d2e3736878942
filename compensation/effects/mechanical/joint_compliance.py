"""A joint twists under the moment of gravity about its axis."""

from collections.abc import Iterator

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts, tie
from armd.compensation.model.pose_factors import GravityTorque
from armd.compensation.wording import format_plain


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        terms = tie([(f"theta_{k}", 1.0)], GravityTorque(joint=k))
        column = Column("compliance", "rad/Nm", 6e-6, terms)
        depends = tuple(f"q{j}" for j in facts.joints if j >= min(2, k))
        yield Candidate("joint_compliance", location.joint(k), (column,), depends)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    twist_urad = format_plain(abs(amplitudes[0]) * 1e6)
    return f"{candidate.location} twists by {twist_urad} µrad per Nm of gravity"


EFFECT = Effect(
    "joint_compliance",
    "bearing, shaft and counterbalance between encoder and link twist under load",
    "eccentricity of joint 2",
    "repeat the poses with half a kilogram at the wrist",
    list_candidates,
    describe,
    by_weight=True,
    as_coarse_as_the_arm=True,
)

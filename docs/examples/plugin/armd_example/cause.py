"""A cause for `armd diagnose`: cables to the next joint pull a joint aside as that one turns."""

from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, Effect, tie
from armd.compensation.model.pose_factors import Angle
from armd.compensation.wording import ARC_SECOND, seconds_of_arc


def list_candidates(facts):
    for k in facts.joints[:-1]:
        terms = tie([(f"theta_{k}", 1.0)], Angle(joint=k + 1))
        column = Column("pull", "rad per rad", 5 * ARC_SECOND, terms)
        yield Candidate("cable_pull", location.joint(k), (column,), (f"q{k + 1}",))


def reading(candidate, amplitudes):
    angle = seconds_of_arc(amplitudes[0])
    return f"{candidate.location} is pulled aside by {angle} per radian of the next joint"


EFFECT = Effect(
    "cable_pull",
    "cables to the next joint are stiff, and pull as it turns",
    "a joint that twists under gravity (joint compliance)",
    "measure the same poses with the cables of that joint loosened",
    list_candidates,
    reading,
)

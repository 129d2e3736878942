"""A long stylus sags by its own weight, most when it is level."""

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts, tie_tip
from armd.compensation.model.pose_factors import GravityDirection
from armd.compensation.wording import format_plain

SHORTEST_MM = 20.0  # a shorter one does not sag


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    stylus = facts.constants[facts.arm.layout.tip]
    length = float(np.linalg.norm(stylus))
    if length < SHORTEST_MM:
        return
    across = np.eye(3) - np.outer(stylus, stylus) / length**2
    last = facts.arm.n_joints
    terms = tie_tip(across, lambda axis: GravityDirection(link=last, axis=axis))
    depends = tuple(f"q{k}" for k in facts.joints if k > 1)
    column = Column("sag when level", "mm", 10e-3, terms)
    yield Candidate("stylus_sag", location.TIP, (column,), depends)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    sag_um = format_plain(1e3 * abs(amplitudes[0]))
    return f"the stylus hangs by {sag_um} µm at its tip when it is level"


EFFECT = Effect(
    "stylus_sag",
    "a long or thin stylus bends under its own weight",
    "bending of the last links",
    "measure one seat with the stylus upright, level and at the slopes between",
    list_candidates,
    describe,
    "a stylus of over 20 mm in the tip's offset",
)

"""A link sags under its own weight and under its load.

The link is a uniform round beam from the axis of its joint to the frame at its end. M is the moment
at that end of everything beyond, W that weight, and w the link's own weight. u is the direction of
the link and g that of gravity, all in the frame at its end:

    turn = (L·M⊥ + (W/2 + w/6)·L²·u×g) / EI
    shift = (L²/2·M⊥ + (W/3 + w/8)·L³·u×g) × u / EI
"""

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import AXES, Candidate, Column, Effect, SessionFacts
from armd.compensation.effects.twist import SHORTEST_MM, compute_link_vector, compute_twist_weights
from armd.compensation.model.gravity import STANDARD_GRAVITY, list_link_masses
from armd.compensation.model.pose_factors import GravityDirection, GravityMoment
from armd.compensation.model.terms import Factor, Term
from armd.compensation.wording import format_plain


def _cross(vector: F64) -> F64:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _column(facts: SessionFacts, link: int) -> Column | None:
    vector = compute_link_vector(facts, link)
    length = float(np.linalg.norm(vector)) * 1e-3  # m
    if length * 1e3 < SHORTEST_MM:
        return None
    u = vector / (length * 1e3)
    masses = list_link_masses(facts.arm)[0]
    own_weight, beyond = masses[link - 1] * STANDARD_GRAVITY, masses[link:].sum() * STANDARD_GRAVITY
    across = np.eye(3) - np.outer(u, u)
    # per unit of L/EI; shifts in mm
    turn = np.hstack([across, (beyond / 2 + own_weight / 6) * length * _cross(u)])
    bow = np.hstack([across / 2, (beyond / 3 + own_weight / 8) * length * _cross(u)])
    shift = -_cross(u) @ bow * length * 1e3
    names, weights = compute_twist_weights(facts, link, np.vstack([turn, shift]))
    factors: list[Factor] = [GravityMoment(link=link, axis=axis) for axis in AXES]
    factors += [GravityDirection(link=link, axis=axis) for axis in AXES]
    terms = tuple(
        Term(parameter=name, basis=[factor], coefficient=float(weights[i, j]))
        for i, name in enumerate(names)
        for j, factor in enumerate(factors)
        if abs(weights[i, j]) > 1e-6 * np.abs(weights[i]).max()
    )
    return Column("compliance", "rad/Nm", 8e-6, terms)


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        column = _column(facts, k)
        if column is not None:
            depends = tuple(f"q{j}" for j in facts.joints if j > 1)
            yield Candidate("link_bending", location.link(k), (column,), depends)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    angle_urad = format_plain(abs(amplitudes[0]) * 1e6)
    return f"{candidate.location} bends by {angle_urad} µrad per Nm at its end"


EFFECT = Effect(
    "link_bending",
    "a tube bends under its own weight and its load",
    "compliance of the joint next to it",
    "repeat the poses with half a kilogram at the wrist",
    list_candidates,
    describe,
    by_weight=True,
    as_coarse_as_the_arm=True,
)

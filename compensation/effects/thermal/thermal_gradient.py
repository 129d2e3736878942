"""A temperature difference bends a link: curvature c·ΔT along it.

The end turns by c·ΔT·L about an axis across the link and shifts by half of that turn's lever.
"""

from collections.abc import Iterator

import numpy as np

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
from armd.compensation.effects.twist import SHORTEST_MM, compute_link_vector, compute_twist_weights
from armd.compensation.wording import format_plain

TYPICAL_RAD_PER_M_K = 1.2e-4


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        vector = compute_link_vector(facts, k)
        length = float(np.linalg.norm(vector)) * 1e-3  # m
        if length * 1e3 < SHORTEST_MM:
            continue
        axes = _across(vector)
        twists = length * np.vstack(
            [axes, np.cross(axes.T, vector).T / 2]
        )  # per rad/m of curvature
        names, weights = compute_twist_weights(facts, k, twists)
        for warm, cold in _differences(facts, k):
            factor = make_temperature({warm: 1.0, cold: -1.0})
            columns = tuple(
                Column(
                    f"curvature {i + 1}",
                    "rad/(m K)",
                    TYPICAL_RAD_PER_M_K,
                    tie(list(zip(names, weights[:, i], strict=True)), factor),
                )
                for i in range(2)
            )
            yield Candidate("thermal_gradient", location.link(k), columns, (warm, cold))


def _differences(facts: SessionFacts, link: int) -> list[tuple[str, str]]:
    """Return the pairs of sensors with one of the link's own; all pairs, if it has none."""
    own_weights = facts.weights(link) or dict.fromkeys(facts.sensors, 1.0)
    pairs = {
        tuple(sorted((name, other_sensor)))
        for name in own_weights
        for other_sensor in facts.sensors
        if name != other_sensor
    }
    return [(a, b) for a, b in sorted(pairs)]


def _across(vector: F64) -> F64:
    """Return two unit vectors across a vector, as columns (3, 2)."""
    across: F64 = np.linalg.svd(vector[None, :])[2][1:].T
    return across


def describe(candidate: Candidate, amplitudes: F64) -> str:
    size = float(np.hypot(*amplitudes))
    warm, cold = candidate.depends_on
    return (
        f"{candidate.location} bends by {format_plain(size * 1e6)} µrad per metre for each kelvin "
        f"between {warm} and {cold}"
    )


EFFECT = Effect(
    "thermal_gradient",
    "the warmer side of a link grows longer than the cooler one",
    "joints whose angle moves with temperature",
    "warm the arm from one side and measure before it evens out",
    list_candidates,
    describe,
    "temperatures of two sensors at least that vary against each other",
    by_temperature=True,
)

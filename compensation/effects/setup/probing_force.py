"""The stylus gives way along the direction of approach (or the tip's radius is wrong)."""

from collections.abc import Iterator
from typing import Literal

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts, plain, tie
from armd.compensation.model.pose_factors import Approach

AXES: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")


def candidates(facts: SessionFacts) -> Iterator[Candidate]:
    if not facts.approach:
        return
    stylus = facts.constants[facts.arm.layout.tip]
    length = float(np.linalg.norm(stylus))
    along = stylus / length if length > 1.0 else np.array([0.0, 0.0, 1.0])
    columns = (
        _deflection("in every direction", np.eye(3)),
        _deflection("across the stylus", np.eye(3) - np.outer(along, along)),
    )
    depends = ("approach_x", "approach_y", "approach_z")
    yield Candidate("probing_force", location.TIP, columns, depends)


def _deflection(name: str, response: F64) -> Column:
    """The tip gives way by *response* (3, 3) times the approach, both in the last frame."""
    terms = tuple(
        term
        for i, axis in enumerate(AXES)
        for term in tie(
            [(f"tip_{to}", float(response[j, i])) for j, to in enumerate(AXES)],
            Approach(axis=axis, frame="tip"),
        )
    )
    return Column(name, "mm", 7e-3, terms)


def reading(candidate: Candidate, amplitudes: F64) -> str:
    flat, bent = np.abs([amplitudes[0], amplitudes.sum()]) * 1e3
    return f"the tip yields {plain(bent)} µm across the stylus and {plain(flat)} µm along it"


EFFECT = Effect(
    "probing_force",
    "probing bends the stylus; a wrong tip radius looks the same",
    "a wrong tip radius",
    "touch the same target from several directions, softly and hard",
    candidates,
    reading,
    "the direction of approach at the readings (approach_x, …)",
)

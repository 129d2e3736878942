"""The stylus yields along the direction of approach (or the tip's radius is wrong)."""

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts, tie_tip
from armd.compensation.model.pose_factors import Approach
from armd.compensation.wording import format_plain


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    if not facts.approach:
        return
    stylus = facts.constants[facts.arm.layout.tip]
    length = float(np.linalg.norm(stylus))
    along = stylus / length if length > 1.0 else np.array([0.0, 0.0, 1.0])
    columns = tuple(
        Column(name, "mm", 7e-3, tie_tip(response, lambda axis: Approach(axis=axis, frame="tip")))
        for name, response in (
            ("in every direction", np.eye(3)),
            ("across the stylus", np.eye(3) - np.outer(along, along)),
        )
    )
    depends = ("approach_x", "approach_y", "approach_z")
    yield Candidate("probing_force", location.TIP, columns, depends)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    along_um, across_um = map(format_plain, np.abs([amplitudes[0], amplitudes.sum()]) * 1e3)
    return f"the tip yields {across_um} µm across the stylus and {along_um} µm along it"


EFFECT = Effect(
    "probing_force",
    "probing bends the stylus; a wrong tip radius looks the same",
    "a wrong tip radius",
    "touch the same target from several directions, softly and hard",
    list_candidates,
    describe,
    "the direction of approach at the readings (approach_x, …)",
)

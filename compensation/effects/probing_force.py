"""The stylus gives way along the direction of approach (or the tip's radius is wrong)."""

from collections.abc import Iterator

from armd.compensation.effects.effect import F64, Candidate, Column, Effect, Scene, tie
from armd.compensation.terms import Approach


def candidates(scene: Scene) -> Iterator[Candidate]:
    if not scene.approach:
        return
    terms = tuple(
        term
        for axis in ("x", "y", "z")
        for term in tie([(f"tip_{axis}", 1.0)], Approach(axis=axis, frame="tip"))
    )
    column = Column("deflection", "mm", 7e-3, terms)
    depends = ("approach_x", "approach_y", "approach_z")
    yield Candidate("probing_force", "tip", (column,), depends)


def reading(candidate: Candidate, amplitudes: F64) -> str:
    return f"the tip yields {abs(amplitudes[0]) * 1e3:.2g} µm along the approach"


EFFECT = Effect(
    "probing_force",
    "probing bends the stylus; a wrong tip radius looks the same",
    "a wrong tip radius",
    "touch the same target from several directions, softly and hard",
    candidates,
    reading,
)

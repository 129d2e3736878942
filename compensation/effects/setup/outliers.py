"""Single readings that belong to no effect; found by their size, not by a signature."""

from collections.abc import Iterator

from armd.compensation.effects.effect import F64, Candidate, Effect, SessionFacts


def candidates(_: SessionFacts) -> Iterator[Candidate]:
    """None: `diagnose.fitting.outliers` looks for readings, not for a signature."""
    return iter(())


def reading(_: Candidate, amplitudes: F64) -> str:
    return f"{len(amplitudes)} readings belong to no effect: take them again"


EFFECT = Effect(
    "outliers",
    "a ball not seated, a button pressed too early, a bumped table",
    "heavy tails of the noise",
    "measure the named readings again",
    candidates,
    reading,
)

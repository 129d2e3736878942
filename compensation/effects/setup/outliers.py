"""Single readings that no cause explains; found by their size, not by a signature."""

from collections.abc import Iterator

from armd.arrays import F64
from armd.compensation.effects.effect import Candidate, Effect, SessionFacts
from armd.terminal.counted import format_count


def list_candidates(_: SessionFacts) -> Iterator[Candidate]:
    """Return no candidate: `diagnose.diagnose` searches for readings, not for a signature."""
    return iter(())


def describe(_: Candidate, amplitudes: F64) -> str:
    count = format_count(len(amplitudes), "reading")
    return f"{count} far from where all others put them: measure again"


EFFECT = Effect(
    "outliers",
    "a ball not seated, a button pressed too early, a bumped table",
    "heavy tails of the noise",
    "measure the named readings again",
    list_candidates,
    describe,
)

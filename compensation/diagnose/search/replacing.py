"""What a set of findings must show to take another's place.

It was chosen by the same readings, those that are held out in turn too, so being likelier is not
enough for other names. It is for what only says more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from armd.compensation.diagnose.constants import (
    AS_WELL,
    BEYOND_CHANCE,
    CLEARLY,
    CONTRADICTED,
    REPLACING_SIGMAS,
)
from armd.compensation.effects.by_session import can_follow_anything
from armd.compensation.effects.effect import Candidate


@dataclass(frozen=True)
class Required:
    """By how many standard errors a set must predict readings held out better."""

    clearly_likelier: float
    as_likely: float | None  # within what evidence can hold against it; None: not then

    def held_out(self, likelier: float) -> float | None:
        """Of a set that is so many nats *likelier*; None where nothing would be enough."""
        if likelier >= math.log(CLEARLY):
            return self.clearly_likelier
        return self.as_likely if likelier >= -AS_WELL else None


def make_required(findings: Sequence[Candidate], instead_of: Sequence[Candidate]) -> Required:
    """What *findings* must show to be told *instead_of* others."""
    tells_why = _count(can_follow_anything, findings) < _count(can_follow_anything, instead_of)
    names = _count(_is_loose, findings) < _count(_is_loose, instead_of)
    keeps_all = {c.place for c in instead_of} <= {c.place for c in findings}
    says_more = tells_why or names or keeps_all
    return Required(
        -CONTRADICTED if says_more else REPLACING_SIGMAS, BEYOND_CHANCE if tells_why else None
    )


def _count(which: Callable[[Candidate], bool], findings: Sequence[Candidate]) -> int:
    return sum(map(which, findings))


def _is_loose(candidate: Candidate) -> bool:
    """Whether it names no cause, or explains several links at once."""
    return candidate.cause == "unknown" or bool(candidate.instead_of)

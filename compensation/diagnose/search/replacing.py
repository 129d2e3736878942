"""What a set of findings must show to take another's place.

It was chosen by the same readings, those that are held out in turn too, so being likelier is not
enough for other names. It is for what only says more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from armd.compensation.diagnose.scoring.threshold import AS_WELL, CLEARLY
from armd.compensation.effects.by_session import follows_anything
from armd.compensation.effects.effect import Candidate

#: By so many standard errors other names must predict readings held out better. True sets did by
#: 4.9 to 12, false ones on a real arm by 2.3.
BEYOND_DOUBT = 3.0
#: What takes no name away, and gives one to what has none or was a part of another, joins as any
#: cause does: it is enough that what is held out does not contradict it by so many.
CONTRADICTED = 1.0
#: What follows anything in time is as likely as its amplitudes are let be large: which is there, it
#: or causes that say why, what is held out decides, if it tells them apart by so many.
BEYOND_CHANCE = 1.0


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


def required_of(findings: Sequence[Candidate], instead_of: Sequence[Candidate]) -> Required:
    """What *findings* must show to be told *instead_of* others."""
    tells_why = _count(follows_anything, findings) < _count(follows_anything, instead_of)
    names = _count(_is_nameless, findings) < _count(_is_nameless, instead_of)
    keeps_all = {c.place for c in instead_of} <= {c.place for c in findings}
    says_more = tells_why or names or keeps_all
    return Required(
        -CONTRADICTED if says_more else BEYOND_DOUBT, BEYOND_CHANCE if tells_why else None
    )


def _count(which: Callable[[Candidate], bool], findings: Sequence[Candidate]) -> int:
    return sum(map(which, findings))


def _is_nameless(candidate: Candidate) -> bool:
    return candidate.cause == "unknown"

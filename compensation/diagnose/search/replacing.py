"""What a set of findings must show to take another's place: it was chosen by the same readings."""

from __future__ import annotations

import math
from collections.abc import Sequence

from armd.compensation.diagnose.constants import AS_WELL, BEYOND_CHANCE, CLEARLY, CONTRADICTED
from armd.compensation.effects.by_session import can_follow_anything
from armd.compensation.effects.effect import Candidate


def require_heldout(
    findings: Sequence[Candidate], instead_of: Sequence[Candidate], likelier: float
) -> float | None:
    """By how many standard errors *findings*, so many nats *likelier*, must predict readings held
    out better to be told *instead_of* others; None where nothing would be enough.

    A set that says why something follows time may be less likely than what follows anything, as far
    as evidence can hold against it.
    """
    if likelier >= math.log(CLEARLY):
        return -CONTRADICTED
    tells_why = _count_free(findings) < _count_free(instead_of)
    return BEYOND_CHANCE if tells_why and likelier >= -AS_WELL else None


def _count_free(findings: Sequence[Candidate]) -> int:
    return sum(map(can_follow_anything, findings))

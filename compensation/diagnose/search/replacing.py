"""The held-out gain that lets one set of findings replace another chosen by the same readings."""

from __future__ import annotations

import math
from collections.abc import Sequence

from armd.compensation.diagnose.constants import AS_WELL, BEYOND_CHANCE, CLEARLY, CONTRADICTED
from armd.compensation.effects.by_session import can_follow_anything
from armd.compensation.effects.effect import Candidate


def compute_heldout_margin(
    findings: Sequence[Candidate], instead_of: Sequence[Candidate], likelier: float
) -> float | None:
    """Return the held-out gain, in standard errors, with which *findings* replace *instead_of*.

    *likelier*: by how many nats *findings* are likelier. None: no gain would be enough. A set that
    explains why something follows time may be less likely, within what evidence can hold against
    it, than one that follows anything.
    """
    if likelier >= math.log(CLEARLY):
        return -CONTRADICTED
    tells_why = _count_free(findings) < _count_free(instead_of)
    return BEYOND_CHANCE if tells_why and likelier >= -AS_WELL else None


def _count_free(findings: Sequence[Candidate]) -> int:
    return sum(map(can_follow_anything, findings))

"""The odds that one more cause of the catalogue is there beside all findings.

The evidence of each candidate about the last fit is weighed by its prior. A search stops where no
candidate is significant; a cause may still be hidden in the noise, and the findings are then not
the whole set of causes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from armd.compensation.diagnose.constants import FURTHER_ODDS, LEAST_PROBABILITY
from armd.compensation.diagnose.diagnosis import RivalCauses
from armd.compensation.diagnose.scoring.evidence import Scores
from armd.compensation.effects.effect import Candidate


def weigh_further_causes(
    scores: Scores, findings: Sequence[Candidate]
) -> tuple[tuple[RivalCauses, ...], float]:
    """Return the sets with one cause more than the *findings*, and the odds of all such sets.

    *scores* are those given the findings. Only sets that are probable enough are listed, the
    likeliest candidate of each place. Expansion that a calibration could not know is tested by
    itself (`growth`), and no further cause.
    """
    places = {c.place for c in findings}
    log_prior_odds = math.log(FURTHER_ODDS) + scores.log_total
    odds: dict[tuple[str, str], float] = {}
    likeliest: dict[tuple[str, str], tuple[float, Candidate]] = {}
    candidates = scores.signatures.candidates
    for log_share, candidate in zip(scores.log_posterior().tolist(), candidates, strict=True):
        place = candidate.place
        if candidate.expected or place in places or log_share == -math.inf:
            continue
        of_candidate = math.exp(log_prior_odds + log_share)
        odds[place] = odds.get(place, 0.0) + of_candidate
        if place not in likeliest or of_candidate > likeliest[place][0]:
            likeliest[place] = of_candidate, candidate
    listed = [
        RivalCauses((likeliest[place][1],), (), of_place)
        for place, of_place in odds.items()
        if of_place >= LEAST_PROBABILITY
    ]
    return tuple(listed), sum(odds.values())

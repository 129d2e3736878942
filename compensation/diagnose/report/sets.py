"""The probability of the findings as a whole, and other sets of causes for the readings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from armd.compensation.diagnose.constants import (
    CLEARLY,
    LEAST_POSITIVE,
    LEAST_PROBABILITY,
    MOST_RIVALS,
)
from armd.compensation.diagnose.diagnosis import Finding, RivalCauses
from armd.compensation.effects.effect import Candidate


@dataclass(frozen=True)
class CauseSet:
    """Causes that explain the readings together."""

    causes: tuple[Candidate, ...]
    probability: float


def list_sets(
    findings: Sequence[Finding],
    rivals: Sequence[RivalCauses],
    further: Sequence[RivalCauses] = (),
    further_odds: float = 0.0,
) -> list[CauseSet]:
    """List the set of all findings, then the likeliest others; none where nothing was found.

    The names of findings are taken as independent of each other: the probability of all is the
    product of the names' own, divided by one, the odds of all *rivals* and the *further_odds* of
    one more cause. (A finding's probability has the odds of those rivals in it that lack the
    finding; here they are taken out first.) Another set has one finding renamed, a rival's causes
    instead of some findings, or one of the *further* causes beside all.
    """
    if not findings:
        return []
    causes = tuple(finding.candidate for finding in findings)
    of_names = [
        min(finding.probability * (1.0 + _sum_odds(rivals, i)), 1.0)
        for i, finding in enumerate(findings)
    ]
    every_odds = sum(rival.odds for rival in rivals) + further_odds
    probability = math.prod(of_names) / (1.0 + every_odds)
    rival_sets = []
    for rival in (*rivals, *further):
        in_both = (cause for i, cause in enumerate(causes) if i not in rival.finding_numbers)
        rival_sets.append(CauseSet((*in_both, *rival.instead), probability * rival.odds))
    for i, (finding, of_name) in enumerate(zip(findings, of_names, strict=True)):
        # A finding unnamed because several causes fit already has their probability in its own.
        renamed = () if finding.is_of_several_names else finding.rivals
        in_sets = {
            cause.place for rival in rivals if i in rival.finding_numbers for cause in rival.instead
        }
        for alternative in renamed:
            if alternative.candidate.place not in in_sets:
                names = (*causes[:i], alternative.candidate, *causes[i + 1 :])
                odds = alternative.probability / max(of_name, LEAST_POSITIVE)
                rival_sets.append(CauseSet(names, probability * odds))
    probable = [rival for rival in rival_sets if rival.probability >= LEAST_PROBABILITY]
    probable.sort(key=lambda cause_set: -cause_set.probability)
    return [CauseSet(causes, probability), *probable[:MOST_RIVALS]]


def _sum_odds(rivals: Sequence[RivalCauses], finding_number: int) -> float:
    """Return the sum of the odds of the sets that lack a finding."""
    return sum(rival.odds for rival in rivals if finding_number in rival.finding_numbers)


def select_as_probable(rivals: Sequence[RivalCauses]) -> list[RivalCauses]:
    """Select sets of several causes that are at least a tenth as probable, the likeliest first.

    One name for another is among a finding's alternatives.
    """
    probable = [
        rival
        for rival in rivals
        if CLEARLY * rival.odds > 1.0 and len(rival.instead) + len(rival.finding_numbers) > 2
    ]
    return sorted(probable, key=lambda rival: -rival.odds)

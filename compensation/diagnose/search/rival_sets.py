"""The probability of a finding, given whole sets of causes that lack it.

A finding's rivals are weighed one by one, given all other findings. A bearing that wobbles may be
far likelier than a gear alone, although a gear and a sensor together explain as much. Which of the
two sets predicts held-out readings better is then a question of chance, and limits the finding's
probability.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from scipy.special import ndtr

from armd.compensation.diagnose.constants import LEAST_PROBABILITY, MOST_RIVAL_SET
from armd.compensation.diagnose.diagnosis import Finding, Rival, RivalCauses
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.scoring.confusion import compute_likeness
from armd.compensation.diagnose.scoring.shape import is_shape, locate_shape
from armd.compensation.effects.effect import Candidate
from armd.compensation.model.arm import Arm

#: Standard errors by which the second findings predict held-out readings better than the first,
#: about a fit's point.
HeldOutGain = Callable[[Fit, Sequence[Candidate], Sequence[Candidate]], float]


def weigh_rival_sets(
    findings: Sequence[Candidate], rivals: Sequence[tuple[Sequence[Candidate], float]]
) -> tuple[RivalCauses, ...]:
    """Return the odds of sets that lack some *findings* and have others instead.

    *rivals*: sets, and by how many standard errors each predicts held-out readings better than the
    findings. This gain is taken as normal about the truth (pseudo-BMA+: Yao, Vehtari, Simpson,
    Gelman 2018, Bayesian Analysis 13, 917). Sets of the same causes at the same places count once,
    with the larger odds.
    """
    places = {c.place for c in findings}
    weighed: dict[tuple[object, ...], RivalCauses] = {}
    for candidates, better in rivals:
        of_rival = {c.place for c in candidates}
        instead = tuple(c for c in candidates if c.place not in places and not is_shape(c))
        lacking = [i for i, c in enumerate(findings) if c.place not in of_rival and not is_shape(c)]
        shapes = {locate_shape(findings[i]) for i in lacking}
        lacking += [i for i, c in enumerate(findings) if is_shape(c) and c.location in shapes]
        chance = min(float(ndtr(better)), MOST_RIVAL_SET)
        if not (instead and lacking) or chance < LEAST_PROBABILITY:
            continue
        rival = RivalCauses(instead, tuple(sorted(lacking)), chance / (1.0 - chance))
        key = frozenset(c.place for c in instead), rival.finding_numbers
        weighed[key] = max(weighed.get(key, rival), rival, key=lambda causes: causes.odds)
    return tuple(weighed.values())


def number_rivals(
    rivals: Sequence[RivalCauses], remaining: Sequence[int], first: int
) -> tuple[RivalCauses, ...]:
    """Return the *rivals* of *remaining* findings only, which are then numbered from *first*."""
    numbers = {number: first + i for i, number in enumerate(remaining)}
    return tuple(
        replace(rival, finding_numbers=tuple(numbers[i] for i in rival.finding_numbers))
        for rival in rivals
        if all(i in numbers for i in rival.finding_numbers)
    )


def limit_by_rival_sets(
    findings: Sequence[Finding], last: Fit, rivals: Sequence[RivalCauses], arm: Arm
) -> tuple[Finding, ...]:
    """Lower the probability of each finding of the fit *last* by the odds of sets that lack it.

    The causes of these sets become its alternatives.
    """
    weighed = []
    for i, (finding, candidate) in enumerate(zip(findings, last.findings, strict=True)):
        sets = [r for r in rivals if i in r.finding_numbers and not is_shape(candidate)]
        instead = [(cause, rival.odds) for rival in sets for cause in rival.instead]
        every = sum(rival.odds for rival in sets)
        weighed.append(_with_rivals(finding, candidate, instead, every, last, arm))
    return tuple(weighed)


def _with_rivals(
    finding: Finding,
    candidate: Candidate,
    instead: Sequence[tuple[Candidate, float]],
    every: float,
    last: Fit,
    arm: Arm,
) -> Finding:
    """Add the causes *instead* to a finding's rivals, and lower its probability.

    *instead*: causes, each with the odds of its set. *every*: the odds of all sets without the
    finding.
    """
    if not instead:
        return finding
    share = finding.probability / (1.0 + every)
    likely: dict[tuple[str, str], tuple[Candidate, float]] = {}
    for alternative, odds in instead:
        likely[alternative.place] = (
            alternative,
            likely.get(alternative.place, (alternative, 0.0))[1] + share * odds,
        )
    alike = compute_likeness(
        candidate, [alternative for alternative, _ in likely.values()], last, arm
    )
    added = [
        Rival(alternative, probability, likeness.angle_deg)
        for (alternative, probability), likeness in zip(likely.values(), alike, strict=True)
    ]
    remaining = [rival for rival in finding.rivals if rival.candidate.place not in likely]
    ordered = sorted([*remaining, *added], key=lambda rival: -rival.probability)
    return replace(finding, probability=share, rivals=tuple(ordered))

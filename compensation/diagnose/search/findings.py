"""The report of each finding: its significance, its probability, and its alternatives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from armd.compensation.diagnose.constants import (
    INDISTINGUISHABLE_P,
    LEAST_P,
    LEAST_PROBABILITY,
    LEAST_WORTH_EXCLUDING,
    MOST_COMPARED,
    MOST_RIVALS,
)
from armd.compensation.diagnose.diagnosis import Explained, Finding, Rival
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.signatures import identify_kind
from armd.compensation.diagnose.scoring.candidates import ScoredCandidates, score_candidates
from armd.compensation.diagnose.scoring.confusion import compute_likeness
from armd.compensation.diagnose.scoring.evidence import Scores
from armd.compensation.diagnose.scoring.shape import is_shape, locate_shape
from armd.compensation.diagnose.scoring.threshold import compute_family_wise_p
from armd.compensation.diagnose.search.explained_share import compute_explained_shares
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.unknown import remove_name


def report_findings(
    scored: ScoredCandidates, findings: Sequence[Finding], tests: int
) -> tuple[Finding, ...]:
    """Return every finding as it is reported, given all the others."""
    explained = compute_explained_shares(
        scored.fit, [f.statistic for f in findings], scored.scores, tests
    )
    judged = [
        replace(f, explained=explanation, probability=_limit_probability(f, explanation))
        for f, explanation in zip(_withdraw_names(findings), explained, strict=True)
    ]
    return tuple(judged)


def _limit_probability(finding: Finding, explained: Explained) -> float:
    """Limit the probability of a name to its share of what its variables show."""
    named = finding.candidate.cause != "unknown"
    return finding.probability * (explained.share if named and explained.guess else 1.0)


def weigh_findings(scored: ScoredCandidates, tests: int) -> list[Finding]:
    """Weigh every finding, given all the others, under the name that it has in the fit."""
    return [_weigh_finding(scored, i, tests) for i in range(len(scored.fit.findings))]


def _weigh_finding(scored: ScoredCandidates, index: int, tests: int) -> Finding:
    candidate = scored.fit.findings[index]
    of_findings, scores = (
        scored.score_findings_without_acting(index),
        scored.score_eligible_without(index),
    )
    logs = scores.log_places()
    logs |= _weigh_steps_at_instant(scored, index, scores)
    _add_gains_of_shapes(logs, scored, index, scores)
    logs[candidate.place] = scored.log_posterior_of(index, scores)
    total = float(logsumexp(list(logs.values())))
    probability = {place: math.exp(weight - total) for place, weight in logs.items()}
    return Finding(
        candidate,
        max(float(compute_family_wise_p(of_findings.log_p[index], tests)), LEAST_P),
        float(of_findings.statistic[index]),
        probability[candidate.place],
        _list_rivals(candidate, probability, scores, scored),
        _list_variants(candidate, scores),
    )


def _add_gains_of_shapes(
    logs: dict[tuple[str, str], float], scored: ScoredCandidates, index: int, scores: Scores
) -> None:
    """Add to the likeliest rivals' *logs* what they gain if their form may be off, too.

    A finding is weighed with its own shape, and so must its rivals be. Otherwise a disc whose error
    is not quite a sine would be taken with certainty for another joint's.
    """
    finding = scored.fit.findings[index]
    if is_shape(finding):
        return
    posterior, candidates = scores.log_posterior(), scores.signatures.candidates
    rivals: dict[tuple[str, str], Candidate] = {}
    for i in np.argsort(-posterior):
        candidate = candidates[i]
        if len(rivals) == MOST_RIVALS or not np.isfinite(posterior[i]):
            break
        if candidate.cause != "unknown" and candidate.place != finding.place:
            rivals.setdefault(candidate.place, candidate)
    if not rivals:
        return
    gained = scored.gain_of_shapes(index, list(rivals.values()))
    for place, gain in zip(rivals, gained, strict=True):
        logs[place] += float(gain)


def _weigh_steps_at_instant(
    scored: ScoredCandidates, index: int, scores: Scores
) -> dict[tuple[str, str], float]:
    """Return log posterior weights of places where a step is possible at a finding's instant.

    The instant is the finding's refined one; without one the result is empty. On the grid's
    instants alone a rival would seem improbable only because it is early.
    """
    candidate = scored.fit.findings[index]
    instant_unix_s = candidate.instant_unix_s
    if instant_unix_s is None:
        return {}
    grid: dict[tuple[str, ...], list[Candidate]] = {}
    for step in scores.signatures.candidates:
        if _is_grid_step(step) and step.place != candidate.place:
            grid.setdefault(identify_kind(step), []).append(step)
    steps = [find_nearest_step(instant_unix_s, of_kind) for of_kind in grid.values()]
    if not steps:
        return {}
    evidence = score_candidates(scored.projection, steps).score_without_finding(index).log_evidence
    posterior = scores.log_posterior()
    weights = {}
    for place in dict.fromkeys(step.place for step in steps):
        is_of_place = np.array([c.place == place for c in scores.signatures.candidates])
        if not np.isfinite(scores.log_evidence[is_of_place]).any():
            continue
        best_evidence = max(
            e for e, step in zip(evidence, steps, strict=True) if step.place == place
        )
        gain = max(float(best_evidence - scores.log_evidence[is_of_place].max()), 0.0)
        weights[place] = float(logsumexp(posterior[is_of_place])) + gain
    return weights


def _is_grid_step(candidate: Candidate) -> bool:
    return candidate.refine is not None and candidate.instant_unix_s is not None


def find_nearest_step(instant_unix_s: float, steps: Sequence[Candidate]) -> Candidate:
    """Return the step on the grid that is nearest to an instant, refined to be nearer."""

    def distance_s(step: Candidate) -> float:
        return abs(step.setting[0][1] - instant_unix_s)

    nearest = min(steps, key=distance_s)
    return min([nearest, *(nearest.refine() if nearest.refine else ())], key=distance_s)


def _list_rivals(
    candidate: Candidate,
    probability: dict[tuple[str, str], float],
    scores: Scores,
    scored: ScoredCandidates,
) -> tuple[Rival, ...]:
    posterior = scores.log_posterior()
    rivals = []
    for place in sorted(probability, key=lambda key: -probability[key])[:MOST_COMPARED]:
        if place == candidate.place:
            continue
        of_place = [c.place == place for c in scores.signatures.candidates]
        best = int(np.argmax(np.where(of_place, posterior, -np.inf)))
        rival = _move_to_instant(candidate, of_place, scores.signatures.candidates[best], scores)
        rivals.append((rival, probability[place]))
    alike = compute_likeness(
        candidate, [rival for rival, _ in rivals], scored.fit, scored.projection.arm
    )
    reported = [
        Rival(rival, share, likeness.angle_deg)
        for (rival, share), likeness in zip(rivals, alike, strict=True)
        if share >= LEAST_PROBABILITY
        or (likeness.remaining_p > INDISTINGUISHABLE_P and rival.cause != "unknown")
    ]
    named = [rival for rival in reported[MOST_RIVALS:] if rival.candidate.cause != "unknown"]
    return (*reported[:MOST_RIVALS], *named[:1])  # unnamed functions must not hide every cause


def _list_variants(candidate: Candidate, scores: Scores) -> tuple[tuple[Candidate, float], ...]:
    """Return the most probable other candidates one by one, with their probabilities.

    They include those at the finding's own place: a rival may look like another order of
    temperature, but not like this one. Of a grid only the best value is listed.
    """
    posterior = scores.log_posterior()
    variants: dict[tuple[object, ...], tuple[Candidate, float]] = {}
    for i in np.argsort(-posterior):
        variant, share = scores.signatures.candidates[i], float(np.exp(posterior[i]))
        if share < LEAST_WORTH_EXCLUDING or len(variants) == MOST_COMPARED:
            break
        variant_key = (*identify_kind(variant), *(() if variant.refine else variant.setting))
        if variant_key != (
            *identify_kind(candidate),
            *(() if candidate.refine else candidate.setting),
        ):
            variants.setdefault(variant_key, (variant, share))
    return tuple(variants.values())


def _move_to_instant(
    candidate: Candidate, of_place: Sequence[bool], best: Candidate, scores: Scores
) -> Candidate:
    """Move a rival step to the finding's own, refined instant; other rivals stay as they are."""
    instant_unix_s = candidate.instant_unix_s
    if instant_unix_s is None or not _is_grid_step(best):
        return best
    steps = [
        c
        for c, is_of_place in zip(scores.signatures.candidates, of_place, strict=True)
        if is_of_place
    ]
    return find_nearest_step(
        instant_unix_s, [c for c in steps if identify_kind(c) == identify_kind(best)]
    )


def find_likelier_rival(finding: Finding) -> Candidate | None:
    """Return the most probable alternative if it is likelier than the finding, else None."""
    best = max(finding.rivals, key=lambda rival: rival.probability, default=None)
    if best is None or is_shape(finding.candidate):
        return None
    return best.candidate if best.probability > finding.probability else None


def _withdraw_names(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Replace each name that is less likely than another by a structure without a name.

    A finding without a name may be less likely than causes that the search refused, for their size
    or for held-out readings. Its probability is then that of all these together: that something is
    there is certain.
    """

    def rename(finding: Finding) -> Finding:
        if find_likelier_rival(finding) is None:
            return finding
        likelier = [r for r in finding.rivals if r.probability > finding.probability]
        return _withdraw_name(finding, likelier, finding.candidate.depends_on)

    return tuple(map(rename, findings))


def _withdraw_name(
    finding: Finding, rivals: Sequence[Rival], variables: tuple[str, ...]
) -> Finding:
    """Replace a finding's name by a structure in the variables of the cause and of *rivals*.

    The cause may be any of these, and the probability is that of all of them together. The name
    becomes one of the alternatives.
    """
    names = dict.fromkeys([*variables, *(v for r in rivals for v in r.candidate.depends_on)])
    candidate = replace(finding.candidate, cause="unknown", depends_on=tuple(names))
    together = finding.probability + sum(rival.probability for rival in rivals)
    alternatives = list(finding.rivals)
    if finding.candidate.cause != "unknown":
        alternatives.append(Rival(finding.candidate, finding.probability, 0.0))
    alternatives.sort(key=lambda rival: -rival.probability)
    return replace(
        finding,
        candidate=candidate,
        probability=min(together, 1.0),
        rivals=tuple(alternatives),
    )


def as_reported(fit: Fit, reported: Sequence[Finding]) -> Fit:
    """Return the fit without the names of the findings that are reported without one.

    Otherwise a parameter, or a term of an extended calibration, would still have a cause's name.
    """
    named = tuple(
        remove_name(candidate, finding.candidate)
        if finding.candidate.cause == "unknown"
        else candidate
        for candidate, finding in zip(fit.findings, reported, strict=True)
    )
    shapes = {locate_shape(a): locate_shape(b) for a, b in zip(fit.findings, named, strict=True)}
    findings = tuple(replace(c, location=shapes.get(c.location, c.location)) for c in named)
    return replace(fit, findings=findings)

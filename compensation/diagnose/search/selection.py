"""The choice of the next candidate: the most probable one of those that are significant."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Sequence

import numpy as np
from scipy.special import logsumexp

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import (
    AS_WELL,
    MOST_ALIKE,
    MOST_AT_ONCE,
    MOST_BENT,
    MOST_REFINED,
    MOST_RICHER,
    STRONG,
)
from armd.compensation.diagnose.fitting.refit import solve_with_findings
from armd.compensation.diagnose.problem.signatures import identify_kind
from armd.compensation.diagnose.scoring.candidates import (
    ScoredCandidates,
    add_own_shapes,
    score_candidates,
)
from armd.compensation.diagnose.scoring.evidence import Scores, score
from armd.compensation.diagnose.scoring.projection import Projection, make_projection
from armd.compensation.diagnose.scoring.robust_refit import clip_about, compute_unclipped_gain
from armd.compensation.diagnose.scoring.scatter import compute_log_p_by_scatter
from armd.compensation.diagnose.scoring.threshold import is_significant
from armd.compensation.effects.effect import Candidate, join_finding


def choose_finding(scored: ScoredCandidates, tests: int) -> Candidate | None:
    """Choose what joins the findings: a cause or, where none does, the shape of a finding."""
    cause = choose_candidate(scored.projection, scored.scores, tests)
    return cause or choose_shape(scored, tests)


def make_key(findings: Sequence[Candidate]) -> str:
    """Return the key of a set of findings: its places and settings, sorted."""
    return "".join(sorted(repr((c.place, c.setting)) for c in findings))


def choose_candidate(projection: Projection, scores: Scores, tests: int) -> Candidate | None:
    """Return the best candidate of the most probable place; None if nothing is significant.

    The candidate must be significant itself, also by the scatter of the rests that decide on it.
    """
    if not is_significant(scores.log_p, tests).any():
        return None
    candidates, weight, log_p = _refined(scores, projection)
    alike = np.flatnonzero(scores.find_partial_explanations(scores.statistic.max()))
    clipped = weight
    if log_p.min() < STRONG:
        weight = _with_own_tails(weight, alike, candidates, projection)
    places = [c.place for c in candidates]
    total: dict[tuple[str, str], float] = {}
    for place, share in zip(places, np.exp(weight - weight.max()), strict=True):
        total[place] = total.get(place, 0.0) + float(share)
    significant_indices = {int(i) for i in np.flatnonzero(is_significant(log_p, tests))}
    refused: list[Candidate] = []
    while significant_indices:
        likeliest_place = max(
            (places[i] for i in significant_indices), key=lambda place: total[place]
        )
        best = max(
            (i for i in significant_indices if places[i] == likeliest_place),
            key=lambda i: weight[i],
        )
        about = projection
        if log_p[best] < STRONG:
            best = _choose_with_form_error(
                best, significant_indices.intersection(alike), candidates, clipped, projection
            )
            about = clip_about(candidates[best], projection)
        if is_significant(compute_log_p_by_scatter(candidates[best], about), tests):
            return _likelier(candidates[best], refused, projection, tests)
        refused.append(candidates[best])
        significant_indices.remove(best)
    return None


def find_strongest_left(scored: ScoredCandidates, tests: int) -> tuple[Candidate, float]:
    """Return the most significant candidate that is not in the model, and its log p value.

    The log p value is the larger one of the two that `choose_candidate` tests. So a candidate that
    is not named because it fails the second test does not count as an unexplained rest.
    """
    candidates, log_p = scored.scores.signatures.candidates, scored.scores.log_p.copy()
    for i in np.argsort(log_p, kind="stable"):
        if not is_significant(log_p[i], tests):
            break
        log_p[i] = max(log_p[i], compute_log_p_by_scatter(candidates[i], scored.projection))
        if is_significant(log_p[i], tests):
            return candidates[i], float(log_p[i])
    best = int(np.argmin(log_p))
    return candidates[best], float(log_p[best])


def _refined(scores: Scores, projection: Projection) -> tuple[list[Candidate], F64, F64]:
    """Return the candidates (C,) with refined values, their log posterior weights and log p values.

    The likeliest places take the best of values between those of the grid (an instant, a time
    constant). A step that is weighed at the wrong instant loses to whatever else is near.
    """
    candidates = list(scores.signatures.candidates)
    weight, log_p = scores.log_posterior().copy(), scores.log_p.copy()
    finer = _finer(scores)
    strides = {i: _stride(values) for i, values in finer.items()}
    coarse = {i: values[:: strides[i]] for i, values in finer.items()}
    around: dict[int, list[Candidate]] = {}
    for i, (evidence, own_log_p) in _scored(coarse, projection).items():
        best = int(np.argmax(evidence))
        weight[i] += logsumexp(evidence) - np.log(len(evidence)) - scores.log_evidence[i]
        candidates[i], log_p[i] = coarse[i][best], own_log_p[best]
        if (step := strides[i]) > 1:
            around[i] = finer[i][max((best - 1) * step + 1, 0) : (best + 1) * step]
    for i, (evidence, own_log_p) in _scored(around, projection).items():
        best = int(np.argmax(evidence))
        candidates[i], log_p[i] = around[i][best], own_log_p[best]
    return candidates, weight, log_p


def _stride(values: Sequence[Candidate]) -> int:
    """Return the stride with which very many values (instants of thousands of rests) are thinned.

    The thinned values are scored first, then those around the best.
    """
    return round(math.sqrt(len(values) / 2)) if len(values) > MOST_AT_ONCE else 1


def _scored(
    finer: dict[int, list[Candidate]], projection: Projection
) -> dict[int, tuple[F64, F64]]:
    """Return log evidence and log p of each list's candidates, by one pass over the rows."""
    if not finer:
        return {}
    scores = score_candidates(projection, [c for values in finer.values() for c in values]).scores
    edges = np.cumsum([0, *map(len, finer.values())]).tolist()
    return {
        i: (scores.log_evidence[low:high], scores.log_p[low:high])
        for i, (low, high) in zip(finer, itertools.pairwise(edges), strict=True)
    }


def _with_own_tails(
    weight: F64, alike: I64, candidates: Sequence[Candidate], projection: Projection
) -> F64:
    """Return the weights (C,), those of the likeliest kinds with outliers clipped about their own
    fits.
    """
    likeliest: dict[tuple[str, ...], int] = {}
    for i in alike[np.argsort(-weight[alike])]:
        likeliest.setdefault(identify_kind(candidates[i]), int(i))
    indices = list(likeliest.values())[:MOST_ALIKE]
    weight = weight.copy()
    weight[indices] += compute_unclipped_gain(
        [candidates[i] for i in indices], weight[indices], projection
    )
    return weight


def _likelier(
    admitted: Candidate, refused: Sequence[Candidate], projection: Projection, tests: int
) -> Candidate:
    """Return the admitted candidate, or a likelier *refused* one if both explain the same signal.

    A likelier candidate may be refused because few rests support it. The admitted one shows that
    there is something. The likelier one names it, if with it in the model the admitted one is not
    significant.
    """
    for likelier in refused:
        about = clip_about(likelier, projection).fit
        findings = join_finding(about.findings, likelier)
        with_it = make_projection(
            solve_with_findings(about, findings, projection.arm), projection.arm
        )
        if not is_significant(score_candidates(with_it, [admitted]).scores.log_p[0], tests):
            return likelier
    return admitted


def _choose_with_form_error(
    best: int,
    indices: Iterable[int],
    candidates: Sequence[Candidate],
    weight: F64,
    projection: Projection,
) -> int:
    """Return the index of the likeliest candidate if each cause's shape may be off.

    A general basis, or a neighbour in the catalogue, may follow a disc whose error is not quite a
    sine better than the sine does. The cause is still the disc.
    """
    named: dict[tuple[str, str], int] = {}
    for i in sorted(indices, key=lambda i: -weight[i]):
        if candidates[i].cause != "unknown" and len(named) < MOST_BENT:
            named.setdefault(candidates[i].place, i)
    causes = [candidates[i] for i in named.values()]
    if not causes:
        return best
    shaped, gained = add_own_shapes(causes, projection)
    numbers = [best, *named.values(), *named.values()]
    likely = weight[numbers]
    likely[-len(shaped) :] += gained
    likely += compute_unclipped_gain([candidates[best], *causes, *shaped], likely, projection)
    return numbers[int(np.argmax(likely))]


def _finer(scores: Scores) -> dict[int, list[Candidate]]:
    """Return refined values around the best of each of the likeliest places that have a grid.

    For the likeliest unnamed functions these are richer functions of the same variables.
    """
    finer: dict[int, list[Candidate]] = {}
    remaining = {False: MOST_REFINED, True: MOST_RICHER}
    enough = {False: -np.inf, True: scores.log_evidence.max() - AS_WELL}
    places: set[tuple[str, str]] = set()
    for i in np.argsort(-scores.log_posterior()):
        candidate = scores.signatures.candidates[i]
        unknown = candidate.cause == "unknown"
        if not any(remaining.values()) or scores.freedom[i] == 0:
            break
        if candidate.refine is None or candidate.place in places or not remaining[unknown]:
            continue
        if scores.log_evidence[i] >= enough[unknown]:
            places.add(candidate.place)
            remaining[unknown] -= 1
            finer[int(i)] = sorted([candidate, *candidate.refine()], key=_value)
    return finer


def _value(candidate: Candidate) -> float:
    """Return the scanned value; 0 without a grid, which keeps the order."""
    return candidate.setting[0][1] if candidate.setting else 0.0


def choose_next_set(
    best: Candidate, scored: ScoredCandidates, tried_keys: Collection[str], tests: int
) -> list[Candidate] | None:
    """Return the findings with *best* added, or with a shape if that set was tried; None if both
    were.
    """
    findings = join_finding(scored.fit.findings, best)
    if make_key(findings) in tried_keys and (shape := choose_shape(scored, tests)):
        findings = join_finding(scored.fit.findings, shape)
    return None if make_key(findings) in tried_keys else findings


def choose_shape(scored: ScoredCandidates, tests: int) -> Candidate | None:
    """Return the most significant of the findings' shapes, or None."""
    shapes = scored.projection.shapes
    shapes_by_finding = {i: c for i, c in enumerate(shapes.candidates) if c is not None}
    if not shapes_by_finding:
        return None
    sums = score_candidates(scored.projection, list(shapes_by_finding.values())).sums
    log_p = {
        i: float(score(sums, scored.projection.shared_number[shapes.columns[i]]).log_p[j])
        for j, i in enumerate(shapes_by_finding)
    }
    best = min(log_p, key=lambda i: log_p[i])
    return shapes_by_finding[best] if is_significant(log_p[best], tests) else None

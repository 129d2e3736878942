"""The search: one cause after another, each time the most probable, until nothing is wanted.

Forward by posterior among all candidates, admitted by a family-wise threshold on the score;
then a look back whether every finding is still needed and still the best name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from armd.compensation.diagnose.diagnosis import (
    MOST_FINDINGS,
    Finding,
    Progress,
    Refused,
    SearchResult,
)
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.fitting.neighbourhood import refused
from armd.compensation.diagnose.fitting.refit import solve_again
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Baseline, Rests
from armd.compensation.diagnose.problem.session_facts import gather_facts
from armd.compensation.diagnose.problem.signatures import Signatures, compile_candidates
from armd.compensation.diagnose.scoring.candidates import ScoredCandidates, score_candidates
from armd.compensation.diagnose.scoring.projection import make_projection
from armd.compensation.diagnose.scoring.shape import is_shape, shape_place
from armd.compensation.diagnose.scoring.threshold import family_wise, significant
from armd.compensation.diagnose.search.findings import CLEARLY, judge, likelier_rival, weighed
from armd.compensation.diagnose.search.selection import choose, joined, next_finding, shape_wanted
from armd.compensation.effects import catalogue
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.setup.mount_drift import steady_drift
from armd.compensation.effects.unknown import without_a_name
from armd.compensation.model.arm import Arm

MOST_STEPS = 16
MOST_RENAMINGS = 3
#: What is found otherwise, or is no cause.
NOT_SOUGHT = frozenset({"outliers", "unknown", "artefact_moved"})


class Search:
    """One search over one set of rests."""

    def __init__(
        self,
        rests: Rests,
        arm: Arm,
        baseline: Baseline,
        progress: Progress = lambda _text, _share: None,
    ) -> None:
        self.rests = rests
        self.arm = arm
        self.baseline = baseline
        self.facts = gather_facts(rests, arm, baseline)
        self._candidates = list(catalogue.candidates(self.facts))
        self._steady = [steady_drift(self.facts)] if self.facts.timed else []
        self._progress = progress
        self._tests = 1
        self._signatures: Signatures | None = None
        self._refused: list[Refused] = []

    @cached_property
    def first(self) -> ScoredCandidates:
        """The whole catalogue against the model under test."""
        return self._survey(self._fit([]))

    def run(self) -> SearchResult:
        """Search forward, looking back after every step."""
        scored = self.first
        first = current = scored.fit
        untold = scored.scores.silent(set(catalogue.CATALOGUE) - NOT_SOUGHT)
        would_show = scored.scores.shown_at_typical_size()
        seen: set[str] = set()
        for step in range(MOST_STEPS):
            self._progress(f"{len(current.findings)} found", step / MOST_STEPS)
            best = next_finding(scored, self._tests)
            if best is None or len(current.findings) >= MOST_FINDINGS:
                break
            findings = joined(current.findings, best)
            if _key(findings) in seen:  # a circle: the look back undoes what this cause does
                shape = shape_wanted(scored, self._tests)
                findings = joined(current.findings, shape) if shape else findings
                if _key(findings) in seen:
                    break
            seen.add(_key(findings))
            fitted = self._fit(findings, current)
            if reason := refused(fitted, current, self.arm):
                self._refuse(best, reason)
                scored = self._survey(current)
                continue
            current = self._pruned(fitted)
            scored = self._survey(current)
            for _ in range(MOST_RENAMINGS):
                before = current
                current, scored = self._swapped(current, scored)
                if current is before:
                    break
        current, scored, own = self._as_likely(current, scored, seen)
        scores = scored.scores
        remaining = float(family_wise(scores.log_p.min(initial=0.0), self._tests))
        found = judge(scored, own, self._tests)
        steps = [first] if current.findings else []
        steps += [self._fit(current.findings[:i], current) for i in range(1, len(found))]
        last = _as_told(current, found)
        return SearchResult(
            self.facts,
            first,
            last,
            (*steps, last),
            found,
            scores.signatures,
            self._tests,
            remaining,
            scores.signatures.candidates[int(np.argmin(scores.log_p))].depends_on,
            untold,
            would_show,
            tuple(self._refused),
        )

    def _as_likely(
        self, current: Fit, scored: ScoredCandidates, seen: set[str]
    ) -> tuple[Fit, ScoredCandidates, list[Finding]]:
        """With each finding renamed that is less likely than one of its alternatives, all others
        given, as long as that leads somewhere new; and the findings then."""
        told = weighed(scored, self._tests)
        for _ in range(MOST_FINDINGS):
            for found in told:
                rival = likelier_rival(found)
                if rival is None or rival.cause == "unknown":
                    continue
                others = [c for c in current.findings if c is not found.candidate]
                findings = _with_their_causes(joined(others, rival))
                if _key(findings) in seen:
                    continue
                seen.add(_key(findings))
                renamed = self._fit(findings, current)
                if refused(renamed, current, self.arm):
                    continue
                renamed = self._pruned(renamed)
                if rival in renamed.findings:
                    current, scored = renamed, self._survey(renamed)
                    told = weighed(scored, self._tests)
                    break
            else:
                break
        return current, scored, told

    def _refuse(self, candidate: Candidate, reason: str) -> None:
        """Look for it no more."""
        self._refused.append(Refused(candidate, reason))
        kept = [c for c in self._candidates if c.place != candidate.place]
        if len(kept) < len(self._candidates):
            self._candidates, self._signatures = kept, None

    def _fit(self, findings: Sequence[Candidate], before: Fit | None = None) -> Fit:
        """A fit that starts where *before* ended."""
        findings = _with_their_causes(findings)
        known = {}
        if before is not None:
            known = dict(zip(map(id, before.findings), before.amplitudes, strict=True))
        start = [known.get(id(c), np.zeros(len(c.columns))) for c in findings]
        model = self.baseline.model if before is None else before.model
        noise = None if before is None else before.noise
        return fit(self.rests, self.arm, self.baseline, model, findings, start, self._steady, noise)

    def _pruned(self, current: Fit) -> Fit:
        """Without findings that are not significant any more, the weakest first."""
        while current.findings:
            own = score_candidates(make_projection(current, self.arm), current.findings)
            log_p = [float(own.freed(i).log_p[i]) for i in range(len(current.findings))]
            weakest = int(np.argmax(log_p))
            if significant(log_p[weakest], self._tests):
                break
            kept = [c for i, c in enumerate(current.findings) if i != weakest]
            current = self._fit(kept, current)
        return current

    def _swapped(self, current: Fit, scored: ScoredCandidates) -> tuple[Fit, ScoredCandidates]:
        """With a finding renamed where, all others given, another name is clearly likelier."""
        for i, candidate in enumerate(current.findings):
            others = scored.without(i)
            places = others.places()
            best = max(places, key=lambda key: places[key])
            if best == candidate.place:
                continue
            if places[best] > CLEARLY * scored.posterior_of(i, others):
                findings = _with_their_causes([c for c in current.findings if c is not candidate])
                without = solve_again(current, findings, current.noise, self.arm)
                rival = choose(make_projection(without, self.arm), others, self._tests)
                if rival is None or rival.place == candidate.place:
                    continue
                fitted = self._fit(joined(findings, rival), without)
                if reason := refused(fitted, without, self.arm):
                    self._refuse(rival, reason)
                    return current, self._survey(current)
                current = self._pruned(fitted)
                return current, self._survey(current)
        return current, scored

    def _survey(self, current: Fit) -> ScoredCandidates:
        """The whole catalogue against what is left; the first time it is counted."""
        projection = make_projection(current, self.arm)
        if self._signatures is not None:
            return score_candidates(projection, self._signatures)
        self._signatures = compile_candidates(self._candidates, current.linear, self.arm)
        scored = score_candidates(projection, self._signatures)
        self._tests = max(int((scored.scores.freedom > 0).sum()), 1)
        return scored


def _as_told(fit: Fit, found: Sequence[Finding]) -> Fit:
    """The fit with what is told without a name nameless: no parameter of it, and no term of an
    extended calibration, is called by a cause's name."""
    named = tuple(
        without_a_name(own, told.candidate) if told.candidate.cause == "unknown" else own
        for own, told in zip(fit.findings, found, strict=True)
    )
    shapes = {shape_place(a): shape_place(b) for a, b in zip(fit.findings, named, strict=True)}
    findings = tuple(replace(c, location=shapes.get(c.location, c.location)) for c in named)
    return replace(fit, findings=findings)


def _key(findings: Sequence[Candidate]) -> str:
    """What a set of findings is known by."""
    return "".join(sorted(repr((c.place, c.setting)) for c in findings))


def _with_their_causes(findings: Sequence[Candidate]) -> list[Candidate]:
    """No shape without the finding whose shape it is."""
    named = {shape_place(c) for c in findings}
    return [c for c in findings if not is_shape(c) or c.location in named]

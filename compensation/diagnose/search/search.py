"""The search: one cause after another, each time the most probable, until nothing is wanted.

Forward by posterior among all candidates, admitted by a family-wise threshold on the score;
then a look back whether every finding is still needed and still the best name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property, partial

import numpy as np

from armd.compensation.diagnose.constants import (
    AS_WELL,
    CLEARLY,
    CONTRADICTED,
    MOST_FINDINGS,
    MOST_RENAMINGS,
    MOST_SEARCH_STEPS,
    STEP_WORK,
)
from armd.compensation.diagnose.diagnosis import Finding, SearchResult
from armd.compensation.diagnose.fitting.neighbourhood import refused
from armd.compensation.diagnose.fitting.refit import solve_again, with_findings_unsolved
from armd.compensation.diagnose.fitting.through import fit_by_turns
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Baseline, Rests
from armd.compensation.diagnose.problem.session_facts import gather_facts
from armd.compensation.diagnose.problem.signatures import Signatures, compile_candidates
from armd.compensation.diagnose.problem.through import acting_through, with_acting
from armd.compensation.diagnose.scoring.candidates import (
    PartedSurvey,
    ScoredCandidates,
    score_candidates,
    weakest,
)
from armd.compensation.diagnose.scoring.projection import make_projection
from armd.compensation.diagnose.scoring.threshold import family_wise, significant
from armd.compensation.diagnose.search.chance import beside_lasting_noise
from armd.compensation.diagnose.search.findings import (
    as_told,
    judge,
    likelier_rival,
    weighed,
)
from armd.compensation.diagnose.search.growth import with_growth
from armd.compensation.diagnose.search.refusals import Refusals
from armd.compensation.diagnose.search.replacing import required_of
from armd.compensation.diagnose.search.revisit import (
    Revisit,
    RivalSet,
    log_weight,
    may_be_others,
)
from armd.compensation.diagnose.search.rival_sets import beside_rival_sets
from armd.compensation.diagnose.search.selection import (
    choose,
    going_on,
    key_of,
    next_finding,
    strongest_left,
    with_their_causes,
)
from armd.compensation.diagnose.search.work import WorkBudget
from armd.compensation.effects import catalogue
from armd.compensation.effects.effect import Candidate, join_finding
from armd.compensation.effects.setup.mount_drift import steady_drift
from armd.compensation.model.arm import Arm
from armd.compensation.progress import TellShare
from armd.terminal.counted import counted

#: What is found otherwise, or is no cause.
NOT_SOUGHT = frozenset({"outliers", "unknown", "artefact_moved"})

#: By how many standard errors readings held out are predicted better, about a fit's point, with the
#: findings named last than with those named first.
HeldOutGain = Callable[[Fit, Sequence[Candidate], Sequence[Candidate]], float]


class Search:
    """One search over one set of rests."""

    def __init__(
        self,
        rests: Rests,
        arm: Arm,
        baseline: Baseline,
        progress: TellShare = lambda _text, _share: None,
        held_out: HeldOutGain = lambda _about, _before, _after: -math.inf,
        work: WorkBudget | None = None,
        barred: Callable[[Candidate], bool] = lambda _candidate: False,
    ) -> None:
        """*held_out*: what decides between two sets of findings; without, none replaces another.
        *work*: what is computed at most, here and elsewhere. *barred*: whether a candidate is not
        looked for."""
        self.rests = rests
        self.arm = arm
        self.baseline = baseline
        self.facts = gather_facts(rests, arm, baseline)
        every = catalogue.candidates(self.facts)
        self._refusals = Refusals([c for c in every if not barred(c)])
        self._steady = [steady_drift(self.facts)] if self.facts.timed else []
        self._progress = progress
        self._tests = 1
        self._sought: tuple[Sequence[Candidate], Signatures] | None = None
        self._held_out = held_out
        self._work = work or WorkBudget()
        self._rivals: tuple[str, list[RivalSet]] | None = None
        #: the last survey beside findings, if any; many megabytes
        self.parted: PartedSurvey | None = None

    @cached_property
    def first(self) -> ScoredCandidates:
        """The whole catalogue against the model under test."""
        return self._survey(self._fit([]))

    def run(self) -> SearchResult:
        """Search forward, looking back after every step."""
        scored, first = self.first, self.first.fit
        del self.first  # many megabytes; asked for again, it is made again
        current = first
        untold = scored.scores.silent(set(catalogue.CATALOGUE) - NOT_SOUGHT)
        would_show = scored.scores.shown_at_typical_size()
        seen: set[str] = set()
        for step in range(MOST_SEARCH_STEPS):
            self._progress(f"{len(current.findings)} found", step / MOST_SEARCH_STEPS)
            if len(current.findings) >= MOST_FINDINGS:
                break
            if not self._work.may_go_on:
                self._work.skip(f"more than {counted(len(current.findings), 'cause')}")
                break
            best = next_finding(scored, self._tests)
            findings = None if best is None else going_on(best, scored, seen, self._tests)
            if best is None or findings is None:  # nothing is wanted, or a circle
                if self._refusals.ask_again(key_of(current.findings)):
                    scored = self._survey(current)
                    continue
                another = self._revisited(current, scored, seen)
                if another is current:
                    break
                current, scored = another, self._survey(another)
                continue
            seen.add(key_of(findings))
            fitted = self._fit(findings, current)
            if reason := refused(fitted, current, self.arm):
                self._refusals.add(best, reason, key_of(current.findings))
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
        left, log_p = strongest_left(scored, self._tests)
        told = beside_lasting_noise(judge(scored, own, self._tests), scored, self._tests)
        found = self._beside_rival_sets(told, current, scored)
        searched = as_told(current, found)
        last = searched
        if grown := with_growth(searched, self._refusals.candidates, self.arm, self._tests):
            growth, last = grown
            there = [i for i, c in enumerate(searched.findings) if c in last.findings]
            if len(there) < len(found):
                found = tuple(found[i] for i in there)
                searched = self._fit([searched.findings[i] for i in there], searched)
            found = (*self._growth_told(growth)[: len(last.findings) - len(there)], *found)
            self._survey(last)
        return SearchResult(
            self.facts,
            first,
            searched,
            last,
            partial(self._steps, first, last),
            found,
            scored.scores,
            self._tests,
            float(family_wise(log_p, self._tests)),
            left.depends_on,
            untold,
            would_show,
            tuple(self._refusals.told),
        )

    def explain(self, most: int) -> Fit:
        """Add one cause after another, at *most* so many, without looking back at any."""
        scored = self.first
        current = scored.fit
        for step in range(most):
            best = choose(scored.projection, scored.scores, self._tests)
            if best is None:
                break
            fitted = self._fit(join_finding(current.findings, best), current)
            if reason := refused(fitted, current, self.arm):
                self._refusals.add(best, reason, key_of(current.findings))
            else:
                current = fitted
            if step + 1 < most:
                scored = self._survey(current)
        return current

    def _growth_told(self, grown: Fit) -> Sequence[Finding]:
        """What is told of a fit's findings, growth among them, each beside all the others."""
        scored = self._survey(grown)
        told = judge(scored, weighed(scored, self._tests), self._tests)
        return beside_lasting_noise(told, scored, self._tests)

    def _steps(self, first: Fit, last: Fit) -> list[Fit]:
        """With none, the first, the first two … of the *last* fit's findings: with none the
        *first*, with all the *last*."""
        if not last.findings:
            return [last]
        self.baseline = last.baseline
        between = range(1, len(last.findings))
        return [first, *(self._fit(last.findings[:i], last) for i in between), last]

    def _as_likely(
        self, current: Fit, scored: ScoredCandidates, seen: set[str]
    ) -> tuple[Fit, ScoredCandidates, list[Finding]]:
        """With each finding renamed that is less likely than one of its alternatives, all others
        given, as long as that leads somewhere new; and the findings then. What has no name takes
        one that predicts readings held out better."""
        told = weighed(scored, self._tests)
        for _ in range(MOST_FINDINGS):
            for found in told:
                rival = likelier_rival(found)
                if rival is None or rival.cause == "unknown":
                    continue
                others = [c for c in current.findings if c is not found.candidate]
                findings = with_their_causes(join_finding(others, rival))
                if key_of(findings) in seen:
                    continue
                seen.add(key_of(findings))
                if found.candidate.cause == "unknown":
                    better = self._held_out(current, current.findings, findings)
                    if better < -CONTRADICTED:
                        continue
                renamed = self._fit(findings, current)
                if refused(renamed, current, self.arm):
                    continue
                renamed = self._pruned(renamed)
                if any(map(rival.is_like, renamed.findings)):
                    current, scored = renamed, self._survey(renamed)
                    told = weighed(scored, self._tests)
                    break
            else:
                break
        return current, scored, told

    def _revisited(self, current: Fit, scored: ScoredCandidates, seen: set[str]) -> Fit:
        """With another set of findings, where one is as likely as it must be, about its own point
        too, and predicts readings held out as well as it must."""
        for other in self._rival_sets(current, scored):
            key, required = key_of(other.findings), required_of(other.findings, current.findings)
            enough = required.held_out(other.likelier)
            if key in seen or enough is None:
                continue
            if self._held_out(current, current.findings, other.findings) < enough:
                continue
            seen.add(key)
            another = self._fit(other.findings, current)
            if refused(another, current, self.arm):
                continue
            another = self._pruned(another)
            weights = [
                log_weight(another, fitted.findings, self.arm, scored.scores)
                for fitted in (current, another)
            ]
            if required.held_out(weights[1] - weights[0]) is not None:
                return another
        return current

    def _rival_sets(self, current: Fit, scored: ScoredCandidates) -> list[RivalSet]:
        """Other sets that may be there instead of several findings; worked out once."""
        if self.parted is None or not may_be_others(current.findings):
            return []
        key = key_of(current.findings)
        if self._rivals is None or self._rivals[0] != key:
            through = partial(acting_through, facts=self.facts, refused=self._refusals.places)
            tests, work = self._tests, self._work
            revisit = Revisit(scored, self.parted, self.arm, tests, choose, through, work)
            self._rivals = key, revisit.others()
        return self._rivals[1]

    def _beside_rival_sets(
        self, found: Sequence[Finding], current: Fit, scored: ScoredCandidates
    ) -> tuple[Finding, ...]:
        """The findings no surer than the sets without them allow that explain as well."""
        rivals = [
            (other.findings, self._held_out(current, current.findings, other.findings))
            for other in self._rival_sets(current, scored)
            if other.likelier > -AS_WELL
        ]
        return beside_rival_sets(found, current, rivals, self.arm)

    def _fit(self, findings: Sequence[Candidate], before: Fit | None = None) -> Fit:
        """A fit that starts where *before* ended."""
        findings = with_their_causes(findings)
        known = {}
        if before is not None:
            known = dict(zip(map(id, before.findings), before.amplitudes, strict=True))
        start = [known.get(id(c), np.zeros(len(c.columns))) for c in findings]
        model = self.baseline.model if before is None else before.model
        noise = None if before is None else before.noise
        about = self.rests, self.arm, self.baseline, model
        return fit_by_turns(self.facts, *about, findings, start, self._steady, noise)

    def _pruned(self, current: Fit) -> Fit:
        """Without findings that are not significant any more, the weakest first."""
        while current.findings:
            least, log_p = weakest(make_projection(current, self.arm))
            if significant(log_p, self._tests):
                break
            kept = [c for i, c in enumerate(current.findings) if i != least]
            current = self._fit(kept, current)
        return current

    def _swapped(self, current: Fit, scored: ScoredCandidates) -> tuple[Fit, ScoredCandidates]:
        """With a finding renamed where, all others given, another name is clearly likelier."""
        for i, candidate in enumerate(current.findings):
            others = scored.without(i)
            places = others.log_places()
            best = max(places, key=lambda key: places[key])
            if best == candidate.place:
                continue
            if places[best] > math.log(CLEARLY) + scored.log_posterior_of(i, others):
                findings = with_their_causes([c for c in current.findings if c is not candidate])
                without = solve_again(current, findings, self.arm)
                rival = choose(make_projection(without, self.arm), others, self._tests)
                if rival is None or rival.place == candidate.place:
                    continue
                fitted = self._fit(join_finding(findings, rival), without)
                if reason := refused(fitted, without, self.arm):
                    self._refusals.add(rival, reason, key_of(without.findings))
                    return current, self._survey(current)
                current = self._pruned(fitted)
                return current, self._survey(current)
        return current, scored

    def _survey(self, current: Fit) -> ScoredCandidates:
        """The whole catalogue against what is left; where it is another one it is counted."""
        every, refused = self._refusals.candidates, self._refusals.places
        counted = self._sought is not None and self._sought[0] is every
        if self._sought is None or not counted:
            self._sought = every, compile_candidates(every, current.linear, self.arm)
        signatures = with_acting(self._sought[1], current, self.facts, refused, self.arm)
        self.parted = None  # many megabytes
        if current.findings:
            nothing = with_findings_unsolved(current, [], self.arm)
            self.parted = PartedSurvey.of(nothing, signatures, self.arm)
            scored = self.parted.beside(current)
        else:
            scored = score_candidates(make_projection(current, self.arm), signatures)
        if not counted:
            self._tests = max(int((scored.scores.freedom > 0).sum()), 1)
        self._work.add(scored.n_products, STEP_WORK)
        return scored

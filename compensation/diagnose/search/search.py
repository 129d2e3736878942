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
from armd.compensation.diagnose.fitting.alternating_fit import fit_by_turns
from armd.compensation.diagnose.fitting.neighbourhood import find_refusal
from armd.compensation.diagnose.fitting.refit import set_findings, solve_again
from armd.compensation.diagnose.problem.acting_causes import add_acting, list_acting_through
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Baseline, Rests
from armd.compensation.diagnose.problem.session_facts import collect_facts
from armd.compensation.diagnose.problem.signatures import Signatures, compile_candidates
from armd.compensation.diagnose.scoring.candidates import (
    PartedSurvey,
    ScoredCandidates,
    find_weakest,
    score_candidates,
)
from armd.compensation.diagnose.scoring.projection import make_projection
from armd.compensation.diagnose.scoring.threshold import compute_family_wise_p, is_significant
from armd.compensation.diagnose.search.chance import limit_by_lasting_noise
from armd.compensation.diagnose.search.findings import (
    as_reported,
    find_likelier_rival,
    judge,
    weigh_findings,
)
from armd.compensation.diagnose.search.growth import fit_with_growth
from armd.compensation.diagnose.search.refusals import Refusals
from armd.compensation.diagnose.search.replacing import make_required
from armd.compensation.diagnose.search.revisit import (
    Revisit,
    RivalSet,
    compute_log_weight,
    may_be_others,
)
from armd.compensation.diagnose.search.rival_sets import limit_by_rival_sets
from armd.compensation.diagnose.search.selection import (
    choose,
    choose_finding,
    choose_next_set,
    find_strongest_left,
    make_key,
    select_with_causes,
)
from armd.compensation.diagnose.search.work import WorkBudget
from armd.compensation.effects import catalogue
from armd.compensation.effects.effect import Candidate, join_finding
from armd.compensation.effects.setup.mount_drift import make_steady_drift
from armd.compensation.model.arm import Arm
from armd.compensation.progress import TellShare
from armd.terminal.counted import format_count

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
        self.facts = collect_facts(rests, arm, baseline)
        every = catalogue.list_all_candidates(self.facts)
        self._refusals = Refusals([c for c in every if not barred(c)])
        self._steady = [make_steady_drift(self.facts)] if self.facts.timed else []
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
        tried_keys: set[str] = set()
        for step in range(MOST_SEARCH_STEPS):
            self._progress(f"{len(current.findings)} found", step / MOST_SEARCH_STEPS)
            if len(current.findings) >= MOST_FINDINGS:
                break
            if not self._work.may_go_on:
                self._work.skip(f"more than {format_count(len(current.findings), 'cause')}")
                break
            best = choose_finding(scored, self._tests)
            findings = (
                None if best is None else choose_next_set(best, scored, tried_keys, self._tests)
            )
            if best is None or findings is None:  # nothing is wanted, or a circle
                if self._refusals.ask_again(make_key(current.findings)):
                    scored = self._survey(current)
                    continue
                another = self._revisited(current, scored, tried_keys)
                if another is current:
                    break
                current, scored = another, self._survey(another)
                continue
            tried_keys.add(make_key(findings))
            fitted = self._fit(findings, current)
            if reason := find_refusal(fitted, current, self.arm):
                self._refusals.add(best, reason, make_key(current.findings))
                scored = self._survey(current)
                continue
            current = self._pruned(fitted)
            scored = self._survey(current)
            for _ in range(MOST_RENAMINGS):
                before = current
                current, scored = self._swapped(current, scored)
                if current is before:
                    break
        current, scored, findings_weighed = self._as_likely(current, scored, tried_keys)
        strongest, log_p = find_strongest_left(scored, self._tests)
        limited = limit_by_lasting_noise(
            judge(scored, findings_weighed, self._tests), scored, self._tests
        )
        reported = self._limit_by_rival_sets(limited, current, scored)
        searched = as_reported(current, reported)
        last = searched
        if grown := fit_with_growth(searched, self._refusals.candidates, self.arm, self._tests):
            growth, last = grown
            remaining = [i for i, c in enumerate(searched.findings) if c in last.findings]
            if len(remaining) < len(reported):
                reported = tuple(reported[i] for i in remaining)
                searched = self._fit([searched.findings[i] for i in remaining], searched)
            reported = (
                *self._judge_growth(growth)[: len(last.findings) - len(remaining)],
                *reported,
            )
            self._survey(last)
        return SearchResult(
            facts=self.facts,
            first=first,
            searched=searched,
            last=last,
            steps=partial(self._steps, first, last),
            findings=reported,
            scores=scored.scores,
            tests=self._tests,
            remaining_p=float(compute_family_wise_p(log_p, self._tests)),
            remaining_depends_on=strongest.depends_on,
            untold=untold,
            would_show=would_show,
            refused=tuple(self._refusals.refused),
        )

    def explain(self, most_findings: int) -> Fit:
        """Add one cause after another, at most *most_findings*, without looking back at any."""
        scored = self.first
        current = scored.fit
        for step in range(most_findings):
            best = choose(scored.projection, scored.scores, self._tests)
            if best is None:
                break
            fitted = self._fit(join_finding(current.findings, best), current)
            if reason := find_refusal(fitted, current, self.arm):
                self._refusals.add(best, reason, make_key(current.findings))
            else:
                current = fitted
            if step + 1 < most_findings:
                scored = self._survey(current)
        return current

    def _judge_growth(self, grown: Fit) -> Sequence[Finding]:
        """What is told of a fit's findings, growth among them, each beside all the others."""
        scored = self._survey(grown)
        judged = judge(scored, weigh_findings(scored, self._tests), self._tests)
        return limit_by_lasting_noise(judged, scored, self._tests)

    def _steps(self, first: Fit, last: Fit) -> list[Fit]:
        """With none, the first, the first two … of the *last* fit's findings: with none the
        *first*, with all the *last*."""
        if not last.findings:
            return [last]
        self.baseline = last.baseline
        between = range(1, len(last.findings))
        return [first, *(self._fit(last.findings[:i], last) for i in between), last]

    def _as_likely(
        self, current: Fit, scored: ScoredCandidates, tried_keys: set[str]
    ) -> tuple[Fit, ScoredCandidates, list[Finding]]:
        """With each finding renamed that is less likely than one of its alternatives, all others
        given, as long as that leads somewhere new; and the findings then. What has no name takes
        one that predicts readings held out better."""
        weighed_findings = weigh_findings(scored, self._tests)
        for _ in range(MOST_FINDINGS):
            for finding in weighed_findings:
                rival = find_likelier_rival(finding)
                if rival is None or rival.cause == "unknown":
                    continue
                remaining = [c for c in current.findings if c is not finding.candidate]
                findings = select_with_causes(join_finding(remaining, rival))
                if make_key(findings) in tried_keys:
                    continue
                tried_keys.add(make_key(findings))
                if finding.candidate.cause == "unknown":
                    better = self._held_out(current, current.findings, findings)
                    if better < -CONTRADICTED:
                        continue
                renamed = self._fit(findings, current)
                if find_refusal(renamed, current, self.arm):
                    continue
                renamed = self._pruned(renamed)
                if any(map(rival.is_like, renamed.findings)):
                    current, scored = renamed, self._survey(renamed)
                    weighed_findings = weigh_findings(scored, self._tests)
                    break
            else:
                break
        return current, scored, weighed_findings

    def _revisited(self, current: Fit, scored: ScoredCandidates, tried_keys: set[str]) -> Fit:
        """With another set of findings, where one is as likely as it must be, about its own point
        too, and predicts readings held out as well as it must."""
        for rival_set in self._rival_sets(current, scored):
            key, required = (
                make_key(rival_set.findings),
                make_required(rival_set.findings, current.findings),
            )
            enough = required.held_out(rival_set.likelier)
            if key in tried_keys or enough is None:
                continue
            if self._held_out(current, current.findings, rival_set.findings) < enough:
                continue
            tried_keys.add(key)
            another = self._fit(rival_set.findings, current)
            if find_refusal(another, current, self.arm):
                continue
            another = self._pruned(another)
            weights = [
                compute_log_weight(another, fitted.findings, self.arm, scored.scores)
                for fitted in (current, another)
            ]
            if required.held_out(weights[1] - weights[0]) is not None:
                return another
        return current

    def _rival_sets(self, current: Fit, scored: ScoredCandidates) -> list[RivalSet]:
        """Other sets that may be there instead of several findings; worked out once."""
        if self.parted is None or not may_be_others(current.findings):
            return []
        key = make_key(current.findings)
        if self._rivals is None or self._rivals[0] != key:
            through = partial(list_acting_through, facts=self.facts, refused=self._refusals.places)
            tests, work = self._tests, self._work
            revisit = Revisit(scored, self.parted, self.arm, tests, choose, through, work)
            self._rivals = key, revisit.find_rival_sets()
        return self._rivals[1]

    def _limit_by_rival_sets(
        self, findings: Sequence[Finding], current: Fit, scored: ScoredCandidates
    ) -> tuple[Finding, ...]:
        """The findings no surer than the sets without them allow that explain as well."""
        rivals = [
            (rival_set.findings, self._held_out(current, current.findings, rival_set.findings))
            for rival_set in self._rival_sets(current, scored)
            if rival_set.likelier > -AS_WELL
        ]
        return limit_by_rival_sets(findings, current, rivals, self.arm)

    def _fit(self, findings: Sequence[Candidate], before: Fit | None = None) -> Fit:
        """A fit that starts where *before* ended."""
        findings = select_with_causes(findings)
        amplitudes_of = {}
        if before is not None:
            amplitudes_of = dict(zip(map(id, before.findings), before.amplitudes, strict=True))
        start = [amplitudes_of.get(id(c), np.zeros(len(c.columns))) for c in findings]
        model = self.baseline.model if before is None else before.model
        noise = None if before is None else before.noise
        about = self.facts, self.rests, self.arm, self.baseline, model
        return fit_by_turns(*about, findings, start, noise_extra=self._steady, noise=noise)

    def _pruned(self, current: Fit) -> Fit:
        """Without findings that are not significant any more, the weakest first."""
        while current.findings:
            weakest_index, log_p = find_weakest(make_projection(current, self.arm))
            if is_significant(log_p, self._tests):
                break
            remaining = [c for i, c in enumerate(current.findings) if i != weakest_index]
            current = self._fit(remaining, current)
        return current

    def _swapped(self, current: Fit, scored: ScoredCandidates) -> tuple[Fit, ScoredCandidates]:
        """With a finding renamed where, all others given, another name is clearly likelier."""
        for i, candidate in enumerate(current.findings):
            scores = scored.without(i)
            places = scores.log_places()
            best = max(places, key=lambda key: places[key])
            if best == candidate.place:
                continue
            if places[best] > math.log(CLEARLY) + scored.log_posterior_of(i, scores):
                findings = select_with_causes([c for c in current.findings if c is not candidate])
                without = solve_again(current, findings, self.arm)
                rival = choose(make_projection(without, self.arm), scores, self._tests)
                if rival is None or rival.place == candidate.place:
                    continue
                fitted = self._fit(join_finding(findings, rival), without)
                if reason := find_refusal(fitted, without, self.arm):
                    self._refusals.add(rival, reason, make_key(without.findings))
                    return current, self._survey(current)
                current = self._pruned(fitted)
                return current, self._survey(current)
        return current, scored

    def _survey(self, current: Fit) -> ScoredCandidates:
        """The whole catalogue against what is left; where it is another one it is counted."""
        candidates, refused = self._refusals.candidates, self._refusals.places
        counted = self._sought is not None and self._sought[0] is candidates
        if self._sought is None or not counted:
            self._sought = candidates, compile_candidates(candidates, current.linear, self.arm)
        signatures = add_acting(self._sought[1], current, self.facts, refused, self.arm)
        self.parted = None  # many megabytes
        if current.findings:
            nothing = set_findings(current, [], self.arm)
            self.parted = PartedSurvey.from_fit(nothing, signatures, self.arm)
            scored = self.parted.with_findings(current)
        else:
            scored = score_candidates(make_projection(current, self.arm), signatures)
        if not counted:
            self._tests = max(int((scored.scores.freedom > 0).sum()), 1)
        self._work.add(scored.n_products, STEP_WORK)
        return scored

"""The search adds the most probable cause, one at a time, until none is significant.

Candidates are chosen by their posterior and admitted by a family-wise threshold on the score. Then
the search looks back whether every finding is still needed and still has the best name.
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
)
from armd.compensation.diagnose.diagnosis import Finding, RivalCauses, SearchResult
from armd.compensation.diagnose.fitting.neighbourhood import find_refusal
from armd.compensation.diagnose.fitting.refit import solve_with_findings
from armd.compensation.diagnose.problem.acting_causes import list_acting_through
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Baseline, Rests
from armd.compensation.diagnose.scoring.candidates import ScoredCandidates
from armd.compensation.diagnose.scoring.projection import make_projection
from armd.compensation.diagnose.scoring.shape import select_with_causes
from armd.compensation.diagnose.scoring.threshold import compute_family_wise_p, is_significant
from armd.compensation.diagnose.search.find_rival_sets import (
    RivalSet,
    RivalSetSearch,
    may_be_others,
)
from armd.compensation.diagnose.search.findings import (
    as_reported,
    find_likelier_rival,
    report_findings,
    weigh_findings,
)
from armd.compensation.diagnose.search.further_causes import weigh_further_causes
from armd.compensation.diagnose.search.growth import fit_with_growth
from armd.compensation.diagnose.search.replacing import compute_heldout_margin
from armd.compensation.diagnose.search.rival_sets import (
    HeldOutGain,
    limit_by_rival_sets,
    number_rivals,
    weigh_rival_sets,
)
from armd.compensation.diagnose.search.selection import (
    choose_candidate,
    choose_finding,
    choose_next_set,
    find_strongest_left,
    make_key,
)
from armd.compensation.diagnose.search.set_posterior import compute_log_odds, weigh_set
from armd.compensation.diagnose.search.survey import Survey
from armd.compensation.diagnose.search.work import WorkBudget
from armd.compensation.effects import catalogue
from armd.compensation.effects.effect import Candidate, join_finding
from armd.compensation.model.arm import Arm
from armd.compensation.progress import TellShare
from armd.terminal.counted import format_count

#: Causes that are detected elsewhere, and what is no cause.
NOT_SOUGHT = frozenset({"outliers", "unknown", "artefact_moved"})


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
        """Prepare a search of *rests* under the model *baseline*.

        *held_out*: decides between two sets of findings; without it, none replaces another. *work*:
        the bound on what is computed, here and elsewhere. *barred*: whether a candidate is
        excluded.
        """
        self.survey = Survey(rests, arm, baseline, work or WorkBudget(), barred)
        self._progress = progress
        self._held_out = held_out
        self._rivals: tuple[str, list[RivalSet]] | None = None

    @cached_property
    def first_fit(self) -> Fit:
        """The fit of the model under test, without any finding."""
        return self.survey.fit([])

    @cached_property
    def first(self) -> ScoredCandidates:
        """The scores of the whole catalogue under the model under test."""
        return self.survey.score(self.first_fit)

    def run(self) -> SearchResult:
        """Search forward, looking back after every step."""
        survey, scored, first = self.survey, self.first, self.first.fit
        del self.first  # many megabytes; it is computed again if it is needed again
        current = first
        untold = scored.scores.silent(set(catalogue.CATALOGUE) - NOT_SOUGHT)
        would_show = scored.scores.shown_at_typical_size()
        tried_keys: set[str] = set()
        for step in range(MOST_SEARCH_STEPS):
            self._progress(f"{len(current.findings)} found", step / MOST_SEARCH_STEPS)
            if len(current.findings) >= MOST_FINDINGS:
                break
            if not survey.work.may_go_on:
                survey.work.skip(f"more than {format_count(len(current.findings), 'cause')}")
                break
            best = choose_finding(scored, survey.tests)
            findings = (
                None if best is None else choose_next_set(best, scored, tried_keys, survey.tests)
            )
            if best is None or findings is None:  # nothing is significant, or every set was tried
                another = self._revisited(current, scored, tried_keys)
                if another is current:
                    break
                current, scored = another, survey.score(another)
                continue
            tried_keys.add(make_key(findings))
            fitted = survey.fit(findings, current)
            if reason := find_refusal(fitted, current, survey.arm):
                survey.refusals.add(best, reason)
                scored = survey.score(current)
                continue
            current = survey.prune(fitted)
            scored = survey.score(current)
            for _ in range(MOST_RENAMINGS):
                before = current
                current, scored = self._rename_one(current, scored)
                if current is before:
                    break
        current, scored, findings_weighed = self._rename_less_likely(current, scored, tried_keys)
        strongest, log_p = find_strongest_left(scored, survey.tests)
        judged = report_findings(scored, findings_weighed, survey.tests)
        rivals = self._weigh_rival_sets(current, scored)
        reported = limit_by_rival_sets(judged, current, rivals, survey.arm)
        searched = as_reported(current, reported)
        last = searched
        further = weigh_further_causes(scored.scores, searched.findings)
        if grown := fit_with_growth(searched, survey.refusals.candidates, survey.arm, survey.tests):
            growth, last = grown
            remaining = [i for i, c in enumerate(searched.findings) if c in last.findings]
            if len(remaining) < len(reported):
                searched = survey.fit([searched.findings[i] for i in remaining], searched)
                among = number_rivals(rivals, remaining, 0)
                judged = tuple(judged[i] for i in remaining)
                reported = limit_by_rival_sets(judged, searched, among, survey.arm)
            count = len(last.findings) - len(remaining)
            reported = (*self._judge_growth(growth)[:count], *reported)
            rivals = number_rivals(rivals, remaining, count)
            # This also makes the parted survey that of *last*, for the cross-validation.
            further = weigh_further_causes(survey.score(last).scores, last.findings)
        return SearchResult(
            facts=survey.facts,
            first=first,
            searched=searched,
            last=last,
            steps=partial(survey.fit_steps, first, last),
            findings=reported,
            rival_causes=rivals,
            further_causes=further[0],
            further_odds=further[1],
            scores=scored.scores,
            tests=survey.tests,
            remaining_p=float(compute_family_wise_p(log_p, survey.tests)),
            remaining_depends_on=strongest.depends_on,
            untold=untold,
            would_show=would_show,
            refused=tuple(survey.refusals.refused),
        )

    def fit_forward(self, most_findings: int, current: Fit) -> Fit:
        """Add the likeliest cause after another to a fit, at most *most_findings*.

        None is given the best name: the fit shows only whether causes explain the readings.
        """
        survey = self.survey
        scored = survey.score(current)
        for step in range(most_findings):
            scores = scored.scores
            likeliest = int(np.argmax(scores.log_posterior()))
            if not is_significant(scores.log_p[likeliest], survey.tests):
                break
            candidate = scores.signatures.candidates[likeliest]
            current = survey.fit(join_finding(current.findings, candidate), current)
            if step + 1 < most_findings:
                scored = survey.score(current)
        return current

    def _judge_growth(self, grown: Fit) -> Sequence[Finding]:
        """Judge a fit's findings, expansion among them, each given all the others."""
        survey = self.survey
        scored = survey.score(grown)
        return report_findings(scored, weigh_findings(scored, survey.tests), survey.tests)

    def _rename_one(self, current: Fit, scored: ScoredCandidates) -> tuple[Fit, ScoredCandidates]:
        """Rename one finding if, given all others, another name is clearly likelier."""
        survey = self.survey
        for i, candidate in enumerate(current.findings):
            scores = scored.score_eligible_without(i)
            places = scores.log_places()
            best = max(places, key=lambda key: places[key])
            if best == candidate.place:
                continue
            if places[best] > math.log(CLEARLY) + scored.log_posterior_of(i, scores):
                findings = select_with_causes([c for c in current.findings if c is not candidate])
                without = solve_with_findings(current, findings, survey.arm)
                rival = choose_candidate(make_projection(without, survey.arm), scores, survey.tests)
                if rival is None or rival.place == candidate.place:
                    continue
                fitted = survey.fit(join_finding(findings, rival), without)
                if reason := find_refusal(fitted, without, survey.arm):
                    survey.refusals.add(rival, reason)
                    return current, survey.score(current)
                current = survey.prune(fitted)
                return current, survey.score(current)
        return current, scored

    def _rename_less_likely(
        self, current: Fit, scored: ScoredCandidates, tried_keys: set[str]
    ) -> tuple[Fit, ScoredCandidates, list[Finding]]:
        """Rename each finding that is less likely than one of its alternatives, given all others.

        This is repeated as long as it leads to a new set; the findings are returned with it. A
        finding without a name takes a name unless this predicts held-out readings clearly worse.
        """
        survey = self.survey
        weighed_findings = weigh_findings(scored, survey.tests)
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
                renamed = survey.fit(findings, current)
                if find_refusal(renamed, current, survey.arm):
                    continue
                renamed = survey.prune(renamed)
                if any(map(rival.is_like, renamed.findings)):
                    current, scored = renamed, survey.score(renamed)
                    weighed_findings = weigh_findings(scored, survey.tests)
                    break
            else:
                break
        return current, scored, weighed_findings

    def _revisited(self, current: Fit, scored: ScoredCandidates, tried_keys: set[str]) -> Fit:
        """Return the fit of another set of findings that may replace the current one, else
        *current*.

        The set must be likely enough, also about its own point, and predict held-out readings well
        enough (`compute_heldout_margin`).
        """
        survey = self.survey
        for rival_set in self._rival_sets(current, scored):
            key = make_key(rival_set.findings)
            enough = compute_heldout_margin(
                rival_set.findings, current.findings, rival_set.likelier
            )
            if key in tried_keys or enough is None:
                continue
            if self._held_out(current, current.findings, rival_set.findings) < enough:
                continue
            tried_keys.add(key)
            another = survey.fit(rival_set.findings, current)
            if find_refusal(another, current, survey.arm):
                continue
            another = survey.prune(another)
            likelier = compute_log_odds(
                another.findings, current.findings, another, survey.arm, scored.scores
            )
            if compute_heldout_margin(rival_set.findings, current.findings, likelier) is not None:
                return another
        return current

    def _rival_sets(self, current: Fit, scored: ScoredCandidates) -> list[RivalSet]:
        """Return other sets that may be there instead of several findings; computed once."""
        survey = self.survey
        if survey.parted is None or not may_be_others(current.findings):
            return []
        key = make_key(current.findings)
        if self._rivals is None or self._rivals[0] != key:
            through = partial(
                list_acting_through, facts=survey.facts, refused=survey.refusals.places
            )
            rival_search = RivalSetSearch(
                scored,
                survey.parted,
                survey.arm,
                survey.tests,
                choose_candidate,
                weigh_set,
                through,
                survey.work,
            )
            self._rivals = key, rival_search.find_rival_sets()
        return self._rivals[1]

    def _weigh_rival_sets(self, current: Fit, scored: ScoredCandidates) -> tuple[RivalCauses, ...]:
        """Return the odds of sets that explain the readings as well as the findings do."""
        return weigh_rival_sets(
            current.findings,
            [
                (rival_set.findings, self._held_out(current, current.findings, rival_set.findings))
                for rival_set in self._rival_sets(current, scored)
                if rival_set.likelier > -AS_WELL
            ],
        )

"""A test whether another set of causes is likelier than the one that the search found.

The search adds one cause after another. An early choice was made while all others were still in the
residual: an eccentricity may stand for a shift and a bending, a random walk in time for a slip and
a joint that turns with temperature. No single renaming leads from one to the other. So each finding
is taken out in turn and its place is excluded. Causes are then added to the others as in the
search, and the resulting set is compared as a whole: by the evidence of all amplitudes together and
by the causes' priors.

No set with more amplitudes replaces another: on a real arm, many small errors without a cause in
the catalogue make several names likelier than the true one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import Mask
from armd.compensation.diagnose.constants import MOST_FIRST, MOST_IN_PLACE, TRIAL_WORK
from armd.compensation.diagnose.fitting.refit import solve_with_findings
from armd.compensation.diagnose.problem.amplitudes import is_sized
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.signatures import compile_candidates, identify_kind
from armd.compensation.diagnose.scoring.candidates import (
    PartedSurvey,
    ScoredCandidates,
    find_acting_through,
    find_weakest,
)
from armd.compensation.diagnose.scoring.evidence import Scores
from armd.compensation.diagnose.scoring.projection import Projection
from armd.compensation.diagnose.scoring.shape import is_shape, locate_shape
from armd.compensation.diagnose.scoring.threshold import is_significant
from armd.compensation.diagnose.search.work import WorkBudget
from armd.compensation.effects.by_session import can_follow_anything, is_by_session
from armd.compensation.effects.effect import Candidate, join_finding
from armd.compensation.model.arm import Arm

#: Chooses the candidate that joins a projection's findings, by scores and the number of tests.
Choose = Callable[[Projection, Scores, int], Candidate | None]
#: Log posterior of a set of findings, from the projection without any and the catalogue's scores.
#: It is an argument, like `Choose`, and not imported: no chain of imports may exceed eight.
Weigh = Callable[[Sequence[Candidate], Projection, Scores], float]

#: Whether a candidate has the property in question.
Which = Callable[[Candidate], bool]
#: The candidates that act through what a fit has found.
Through = Callable[[Fit], Sequence[Candidate]]


@dataclass(frozen=True)
class RivalSet:
    """Another set of causes for the same residual."""

    findings: tuple[Candidate, ...]
    likelier: float  # nats by which it is likelier than the findings


def may_be_others(findings: Sequence[Candidate]) -> bool:
    """Whether a set of other causes may be behind the findings.

    A single finding was chosen with nothing else in the model. If it has few amplitudes it
    resembles few others, which are its rivals. A nearly free function, above all a random walk,
    follows whatever several causes do together.
    """
    return len(findings) > 1 or any(map(is_sized, findings))


class RivalSetSearch:
    """A comparison of a fit's findings with other sets, all about its point and in its noise."""

    def __init__(
        self,
        scored: ScoredCandidates,
        parted: PartedSurvey,
        arm: Arm,
        tests: int,
        choose: Choose,
        weigh: Weigh,
        through: Through,
        work: WorkBudget | None = None,
    ) -> None:
        """Prepare the comparison of the findings of *scored* with other sets.

        *parted*: the same survey by parts. *choose*: the rule by which the search adds a candidate.
        *weigh*: the log posterior of a set. *through*: the candidates that act through a set of
        findings. *work*: the bound on what is computed.
        """
        self._scored, self._arm, self._tests = scored, arm, tests
        self._choose, self._weigh, self._through = choose, weigh, through
        self._work = work or WorkBudget()
        self._fit = scored.fit
        self._first = parted.without_findings(solve_with_findings(self._fit, [], arm))

    def find_rival_sets(self) -> list[RivalSet]:
        """Return other sets with no more amplitudes, the likeliest first."""
        findings = self._fit.findings
        log_posterior, rival_sets = self._log_posterior(findings), {}
        for i, finding in enumerate(findings):
            if is_shape(finding):
                continue
            away, shape = {i, *find_acting_through(findings, i)}, locate_shape(finding)
            remaining = [c for j, c in enumerate(findings) if j not in away and c.location != shape]
            for barred in _list_exclusions(finding):
                for first in self._list_starts(i, barred):
                    if not self._work.may_try_sets:
                        self._work.skip("the rest of the sets of causes to try instead")
                        break
                    tried = self._filled([*remaining, *first], barred)
                    has_more = _amplitudes(tried) > _amplitudes(findings)
                    if has_more or _places(tried) == _places(findings):
                        continue
                    set_key = frozenset((c.place, c.depends_on, c.setting) for c in tried)
                    likelier = self._log_posterior(tried) - log_posterior
                    rival_sets[set_key] = RivalSet(tuple(tried), likelier)
        return sorted(rival_sets.values(), key=lambda rival_set: -rival_set.likelier)

    def _list_starts(self, index: int, barred: Which) -> list[list[Candidate]]:
        """Return the candidates with which a set begins in the place of a finding.

        An empty list stands for whatever the search would add. If the finding can follow anything,
        each of the likeliest kinds also begins a set: the two causes that it stands for are often
        not the likeliest one and another. The result is empty where no candidate explains a good
        part of the finding.
        """
        scores, finding = self._scored.score_eligible_without(index), self._fit.findings[index]
        candidates = scores.signatures.candidates
        statistic = float(self._scored.score_findings(index).statistic[index])
        is_able = scores.find_partial_explanations(statistic) & (scores.freedom > 0)
        is_able &= np.array([not barred(c) for c in candidates])
        if not is_able.any():
            return []
        if not can_follow_anything(finding):
            return [[]]
        is_able &= ~self._barred_candidates(candidates, barred) & np.array(
            [not _is_free(c) for c in candidates]
        )
        posterior = scores.log_posterior()
        kinds: dict[tuple[str, ...], list[Candidate]] = {}
        for i in sorted(np.flatnonzero(is_able), key=lambda i: -posterior[i]):
            kinds.setdefault(identify_kind(candidates[i]), [candidates[i]])
        return [[], *list(kinds.values())[:MOST_FIRST]]

    def _filled(self, findings: list[Candidate], barred: Which) -> list[Candidate]:
        """Add significant causes to the findings, none of those *barred*, and drop insignificant
        ones.

        Only named causes are added: a function without a name joins where no cause does, and
        replaces none.
        """
        for _ in range(MOST_IN_PLACE):
            scored = self._survey(findings)
            self._work.add(scored.n_products, TRIAL_WORK, of_sets=True)
            is_barred = self._barred_candidates(scored.sums.signatures.candidates, barred)
            candidate = self._choose(
                scored.projection, scored.scores.drop_candidates(is_barred), self._tests
            )
            if candidate is None:
                break
            findings = join_finding(findings, candidate)
        while findings:
            weakest_index, log_p = find_weakest(self._projection(findings))
            if is_significant(log_p, self._tests):
                break
            findings = findings[:weakest_index] + findings[weakest_index + 1 :]
        return findings

    def _barred_candidates(self, candidates: Sequence[Candidate], barred: Which) -> Mask:
        """Return which candidates (C,) may not join a set.

        They are those *barred*, those without a name, and those that act through the present
        findings: other sets have these at other amplitudes or not at all.
        """
        n_first = len(self._first.sums.signatures.candidates)
        return np.array(
            [
                barred(c) or c.cause == "unknown" or (i < n_first and bool(c.through))
                for i, c in enumerate(candidates)
            ]
        )

    def _log_posterior(self, findings: Sequence[Candidate]) -> float:
        return self._weigh(findings, self._first.projection, self._first.scores)

    def _survey(self, findings: Sequence[Candidate]) -> ScoredCandidates:
        """Score the catalogue given findings, with the candidates that act through these."""
        projection = self._projection(findings)
        sums = projection.sums_with(self._first.sums)
        if acting := self._through(projection.fit):
            linear = projection.fit.linear
            sums = sums.with_more(projection.sums(compile_candidates(acting, linear, self._arm)))
        return ScoredCandidates(projection, sums)

    def _projection(self, findings: Sequence[Candidate]) -> Projection:
        fitted = solve_with_findings(self._fit, findings, self._arm)
        return self._first.projection.with_findings_of(fitted)


def _list_exclusions(finding: Candidate) -> list[Which]:
    """Return which candidates may not come again when a finding is taken out, one rule per trial.

    Usually its place is excluded. For a nearly free function (a curve, a random walk) a second
    trial excludes only others that are as free: plainer ones can then join with others. A finding
    that explains several links at once excludes only itself: one of the links may be at its place.
    """

    def place(candidate: Candidate) -> bool:
        return candidate.place == finding.place

    def as_free(candidate: Candidate) -> bool:
        return place(candidate) and _is_free(candidate)

    if finding.instead_of:
        return [finding.is_like]
    return [place, as_free] if _is_free(finding) else [place]


def _is_free(candidate: Candidate) -> bool:
    return is_sized(candidate) or is_by_session(candidate)


def _places(findings: Sequence[Candidate]) -> list[tuple[str, str]]:
    return sorted(c.place for c in findings)


def _amplitudes(findings: Sequence[Candidate]) -> int:
    return sum(len(c.columns) for c in findings)

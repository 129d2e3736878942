"""Whether another set of causes is likelier than the one that the search came to.

One cause after another joins, and an early choice was made while all others were still in the
residual: an eccentricity may stand where a shift and a bending do, a walk in time where a slip does
and a joint that turns with temperature. No single renaming leads from one to the other. So each
finding is taken out in turn, its place barred, the others are added to as the search does, and what
comes of it is compared as a whole: evidence of all amplitudes together, the causes' priors with it.

No set with more amplitudes takes another's place: on a real arm, many small errors that no cause of
the catalogue has make several names likelier than the one that is true.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import Mask
from armd.compensation.diagnose.constants import MOST_FIRST, MOST_IN_PLACE, TRIAL_WORK
from armd.compensation.diagnose.fitting.refit import solve_again
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

#: What joins the findings of a projection, of the candidates with these scores in so many tests.
Choose = Callable[[Projection, Scores, int], Candidate | None]
#: Log posterior of a set of findings, from the projection of none and the catalogue's scores;
#: given, like `Choose`, and not imported: no chain of imports is longer than eight.
Weigh = Callable[[Sequence[Candidate], Projection, Scores], float]

#: Whether a candidate is one of those asked about.
Which = Callable[[Candidate], bool]
#: The candidates that act through what a fit has found.
Through = Callable[[Fit], Sequence[Candidate]]


@dataclass(frozen=True)
class RivalSet:
    """Another set of causes for the same residual."""

    findings: tuple[Candidate, ...]
    likelier: float  # nats, than the set there is


def may_be_others(findings: Sequence[Candidate]) -> bool:
    """Whether findings may stand where a set of others does.

    One alone was chosen beside nothing, and with few amplitudes looks like few others, which are
    its rivals. A nearly free function, a walk above all, follows whatever several do together.
    """
    return len(findings) > 1 or any(map(is_sized, findings))


class Revisit:
    """One fit's findings against other sets, all about its point and in its noise."""

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
        """*parted*: the same survey; *choose*: by what rule the search adds one more, *weigh*: how
        probable a set is, *through*: which candidates a set of findings has that others have not;
        *work*: what is computed at most."""
        self._scored, self._arm, self._tests = scored, arm, tests
        self._choose, self._weigh, self._through = choose, weigh, through
        self._work = work or WorkBudget()
        self._fit = scored.fit
        self._first = parted.without_findings(solve_again(self._fit, [], arm))

    def find_rival_sets(self) -> list[RivalSet]:
        """Other sets of no more amplitudes, the likeliest first."""
        findings = self._fit.findings
        log_posterior, rival_sets = self._log_posterior(findings), {}
        for i, finding in enumerate(findings):
            if is_shape(finding):
                continue
            away, shape = {i, *find_acting_through(findings, i)}, locate_shape(finding)
            remaining = [c for j, c in enumerate(findings) if j not in away and c.location != shape]
            for barred in _barred(finding):
                for first in self._firsts(i, barred):
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

    def _firsts(self, index: int, barred: Which) -> list[list[Candidate]]:
        """What to begin with in the place of a finding: whatever the search would add; of what
        follows anything, each of the likeliest kinds in turn, for two that it stands for are often
        not the likeliest one and another. Nothing, where nothing explains a good part of it."""
        scores, finding = self._scored.without(index), self._fit.findings[index]
        candidates = scores.signatures.candidates
        statistic = float(self._scored.score_findings(index).statistic[index])
        is_able = scores.explain_as_well(statistic) & (scores.freedom > 0)
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
        """The findings with what else is wanted, none of those *barred*; significant ones.

        Causes only: what has no name joins where no cause does, and takes the place of none.
        """
        for _ in range(MOST_IN_PLACE):
            scored = self._survey(findings)
            self._work.add(scored.n_products, TRIAL_WORK)
            is_barred = self._barred_candidates(scored.sums.signatures.candidates, barred)
            candidate = self._choose(
                scored.projection, scored.scores.without(is_barred), self._tests
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
        """(C,) which do not join: what is barred or has no name, and what acts through the causes
        of the set there is, which others have at other amplitudes or not at all."""
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
        """The catalogue beside findings, with what acts through these."""
        projection = self._projection(findings)
        sums = projection.sums_with(self._first.sums)
        if acting := self._through(projection.fit):
            linear = projection.fit.linear
            sums = sums.with_more(projection.sums(compile_candidates(acting, linear, self._arm)))
        return ScoredCandidates(projection, sums)

    def _projection(self, findings: Sequence[Candidate]) -> Projection:
        fitted = solve_again(self._fit, findings, self._arm)
        return self._first.projection.with_findings_of(fitted)


def _barred(finding: Candidate) -> list[Which]:
    """What may not come again where a finding is taken out: its place; or, of a nearly free
    function (a curve, a walk), only others as free, so that plainer ones join beside others; of
    one that explains several links at once, itself: one of them may be at its place."""

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

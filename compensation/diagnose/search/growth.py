"""The expansion of links that a calibration could not know and that the readings show.

While the search looks for causes, the expansion that the calibration could not know absorbs:
otherwise a common expansion of all links looks like one or two causes that are not there. When all
else is found, expansion is tested by itself, link by link: none, one coefficient for the whole
link, or one for each of its pieces. Each link is as likely to expand as not. The choice starts from
none and from all, and changes one link at a time until no change is likelier. Links that are not
significant given the others are dropped.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import AS_QUIET_GROWN, EXPECTED_PRIOR, MOST_GROWTH_ROUNDS
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.fitting.free_expansion import drop_growth
from armd.compensation.diagnose.fitting.neighbourhood import find_refusal
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Baseline
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.diagnose.scoring.candidates import find_weakest
from armd.compensation.diagnose.scoring.evidence import compute_log_bayes_factors, compute_log_tail
from armd.compensation.diagnose.scoring.projection import make_projection
from armd.compensation.diagnose.scoring.threshold import is_significant
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.older import OLDER, start_at_calibration
from armd.compensation.model.arm import Arm


def fit_with_growth(
    current: Fit, candidates: Iterable[Candidate], arm: Arm, tests: int
) -> tuple[Fit, Fit] | None:
    """Fit the expansion that the readings show as findings in front of a fit's own.

    Two fits are returned, or None where the readings show no expansion. In the first no other
    length expands: it gives the findings' significance and probability. In the second the other
    lengths expand by what the calibration could not know: it gives the sizes and all else.
    """
    links = _ways_to_grow(candidates) if current.baseline.growth else []
    if not links:
        return None
    closed = drop_growth(current.baseline)
    about = _fitted(current, closed, current.findings, current.amplitudes, arm)
    grown = _grown(about, links, arm)
    if not grown:
        return None
    nothing = [np.zeros(len(c.columns)) for c in grown]
    findings, start = [*grown, *current.findings], [*nothing, *current.amplitudes]
    weighed = _prefer_growth_since_calibration(
        _fitted(current, closed, findings, start, arm), len(grown), arm, tests
    )
    findings = list(weighed.findings)
    named = {t.parameter for c in grown for column in c.columns for t in column.terms}
    remaining_baseline = drop_growth(current.baseline, named)
    last = _fitted(current, remaining_baseline, findings, weighed.amplitudes, arm)
    return None if find_refusal(last, about, arm) else (weighed, last)


def _prefer_growth_since_calibration(weighed: Fit, grown: int, arm: Arm, tests: int) -> Fit:
    """Replace the first *grown* findings by expansion since the calibration, if this saves others.

    Such expansion starts at the reference temperature. Without it, the length of a link at the
    calibration's temperature would be taken for a shifted constant. The noise must be no larger.
    """
    newer = [start_at_calibration(c) for c in weighed.findings[:grown]]
    findings, start = [*newer, *weighed.findings[grown:]], list(weighed.amplitudes)
    fitted = _fitted(weighed, weighed.baseline, findings, start, arm)
    while len(fitted.findings) > grown:
        weakest_index, log_p = find_weakest(make_projection(fitted, arm))
        if weakest_index < grown or is_significant(log_p, tests):
            break
        remaining = [i for i in range(len(fitted.findings)) if i != weakest_index]
        findings, start = (
            [fitted.findings[i] for i in remaining],
            [fitted.amplitudes[i] for i in remaining],
        )
        fitted = _fitted(fitted, fitted.baseline, findings, start, arm)
    fewer = len(fitted.findings) < len(weighed.findings)
    as_quiet = fitted.noise.own_mm < AS_QUIET_GROWN * weighed.noise.own_mm
    return fitted if fewer and as_quiet else weighed


def _ways_to_grow(candidates: Iterable[Candidate]) -> list[list[Candidate]]:
    """Return for each link the candidates for expansion beyond what the calibration absorbed."""
    by_link: dict[str, list[Candidate]] = {}
    for candidate in candidates:
        if candidate.expected and OLDER in candidate.columns[0].name:
            by_link.setdefault(str(candidate.location), []).append(candidate)
    return list(by_link.values())


def _fitted(
    current: Fit, baseline: Baseline, findings: Sequence[Candidate], start: Sequence[F64], arm: Arm
) -> Fit:
    rests = current.linear.rests
    return fit(rests, arm, baseline, baseline.model, findings, start, noise=current.noise)


class _Growth:
    """The links' possible expansions, scored on a fit's residual, projected on what absorbs."""

    def __init__(self, about: Fit, links: Sequence[Sequence[Candidate]], arm: Arm) -> None:
        self.links = [list(options) for options in links]
        every = [candidate for options in self.links for candidate in options]
        blocks = make_finding_columns(about.linear, every, arm)
        projection = make_projection(about, arm)
        white, cleared = projection.clear_of_all(np.hstack(blocks))
        residual = about.noise.whiten(about.residual[:, None])
        self._gram, self._side = white.T @ cleared, (cleared.T @ residual)[:, 0]
        self._prior_sd = np.array([column.prior_sd for c in every for column in c.columns])
        edges = np.cumsum([0, *(block.shape[1] for block in blocks)])
        numbers = iter(range(len(every)))
        self._columns = [
            [np.arange(edges[i], edges[i + 1]) for i in (next(numbers) for _ in options)]
            for options in self.links
        ]

    def log_weight(self, chosen: Sequence[int | None]) -> float:
        """Return log (evidence × prior) of one candidate (or none) for each link."""
        prior = sum(
            np.log((1.0 - EXPECTED_PRIOR) if option is None else EXPECTED_PRIOR / len(options))
            for option, options in zip(chosen, self.links, strict=True)
        )
        columns = self._columns_of(chosen)
        if not columns.size:
            return float(prior)
        evidence = compute_log_bayes_factors(
            self._gram[np.ix_(columns, columns)][None],
            self._side[columns][None],
            self._prior_sd[columns][None],
            np.full((1, len(columns)), np.inf),
        )
        return float(prior + evidence[0])

    def likeliest(self, start: Sequence[int | None]) -> list[int | None]:
        """Return the best candidates from *start* on, changing one link at a time while that is
        likelier.
        """
        chosen, weight = list(start), self.log_weight(start)
        for _ in range(MOST_GROWTH_ROUNDS):
            before = list(chosen)
            for link, options in enumerate(self.links):
                for option in (None, *range(len(options))):
                    changed = [*chosen[:link], option, *chosen[link + 1 :]]
                    if (likelier := self.log_weight(changed)) > weight:
                        chosen, weight = changed, likelier
            if chosen == before:
                break
        return chosen

    def log_p(self, link: int, chosen: Sequence[int | None]) -> float:
        """Return the log p value of a link's expansion, given the others chosen."""
        other_columns = self._columns_of([*chosen[:link], None, *chosen[link + 1 :]])
        columns = self._columns_of(
            [None if i != link else option for i, option in enumerate(chosen)]
        )
        inverse = np.linalg.pinv(self._gram[np.ix_(other_columns, other_columns)], hermitian=True)
        across = self._gram[np.ix_(columns, other_columns)] @ inverse
        gram = (
            self._gram[np.ix_(columns, columns)]
            - across @ self._gram[np.ix_(other_columns, columns)]
        )
        side = self._side[columns] - across @ self._side[other_columns]
        statistic = float(side @ np.linalg.pinv(gram, hermitian=True) @ side)
        return float(compute_log_tail(np.array([statistic]), np.array([len(columns)]))[0])

    def _columns_of(self, chosen: Sequence[int | None]) -> I64:
        blocks = [
            self._columns[link][option] for link, option in enumerate(chosen) if option is not None
        ]
        return np.concatenate([np.empty(0, dtype=np.int64), *blocks])


def _grown(about: Fit, links: Sequence[Sequence[Candidate]], arm: Arm) -> list[Candidate]:
    """Return the likeliest expansion, each link's significant given the others."""
    growth = _Growth(about, links, arm)
    starts: list[list[int | None]] = [[None] * len(links), [0] * len(links)]
    chosen = max(map(growth.likeliest, starts), key=growth.log_weight)
    while True:
        log_p = {
            link: growth.log_p(link, chosen)
            for link, option in enumerate(chosen)
            if option is not None
        }
        weakest = max(log_p, key=lambda link: log_p[link], default=None)
        if weakest is None or is_significant(log_p[weakest], len(links)):
            break
        chosen[weakest] = None
    return [links[link][option] for link, option in enumerate(chosen) if option is not None]

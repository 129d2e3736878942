"""Fits of findings to one set of rests, and the scores of the whole catalogue about them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from armd.compensation.diagnose.constants import STEP_WORK
from armd.compensation.diagnose.fitting.alternating_fit import fit_by_turns
from armd.compensation.diagnose.fitting.refit import set_findings
from armd.compensation.diagnose.problem.acting_causes import add_acting
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
from armd.compensation.diagnose.scoring.shape import select_with_causes
from armd.compensation.diagnose.scoring.threshold import is_significant
from armd.compensation.diagnose.search.refusals import Refusals
from armd.compensation.diagnose.search.work import WorkBudget
from armd.compensation.effects import catalogue
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.setup.mount_drift import make_steady_drift
from armd.compensation.model.arm import Arm


class Survey:
    """The state of a search between its steps: candidates, number of tests, fits."""

    def __init__(
        self,
        rests: Rests,
        arm: Arm,
        baseline: Baseline,
        work: WorkBudget,
        barred: Callable[[Candidate], bool],
    ) -> None:
        """Prepare fits and scores of *rests* under the model *baseline*.

        *work*: the bound on what is computed, here and elsewhere. *barred*: whether a candidate is
        excluded.
        """
        self.rests = rests
        self.arm = arm
        self.baseline = baseline
        self.work = work
        self.facts = collect_facts(rests, arm, baseline)
        every = catalogue.list_all_candidates(self.facts)
        self.refusals = Refusals([c for c in every if not barred(c)])
        self.tests = 1
        self._steady = [make_steady_drift(self.facts)] if self.facts.timed else []
        self._sought: tuple[Sequence[Candidate], Signatures] | None = None
        #: the last scores given findings, if any; many megabytes
        self.parted: PartedSurvey | None = None

    def fit(self, findings: Sequence[Candidate], before: Fit | None = None) -> Fit:
        """Fit findings under the model under test, starting where *before* ended."""
        findings = select_with_causes(findings)
        amplitudes_of = {}
        if before is not None:
            amplitudes_of = dict(zip(map(id, before.findings), before.amplitudes, strict=True))
        start = [amplitudes_of.get(id(c), np.zeros(len(c.columns))) for c in findings]
        baseline = self.baseline if before is None else before.baseline
        model = baseline.model if before is None else before.model
        noise = None if before is None else before.noise
        about = self.facts, self.rests, self.arm, baseline, model
        return fit_by_turns(*about, findings, start, noise_extra=self._steady, noise=noise)

    def prune(self, current: Fit) -> Fit:
        """Drop findings that are not significant any more, the weakest first."""
        while current.findings:
            weakest_index, log_p = find_weakest(make_projection(current, self.arm))
            if is_significant(log_p, self.tests):
                break
            remaining = [c for i, c in enumerate(current.findings) if i != weakest_index]
            current = self.fit(remaining, current)
        return current

    def fit_steps(self, first: Fit, last: Fit) -> list[Fit]:
        """Return the fits with none, the first, the first two … of the *last* fit's findings.

        The fit with none is *first*, the fit with all is *last*; without findings only *last* is
        returned.
        """
        if not last.findings:
            return [last]
        between = range(1, len(last.findings))
        return [first, *(self.fit(last.findings[:i], last) for i in between), last]

    def score(self, current: Fit) -> ScoredCandidates:
        """Score the whole catalogue on the residual; set `tests` where the candidates changed."""
        candidates, refused = self.refusals.candidates, self.refusals.places
        counted = self._sought is not None and self._sought[0] is candidates
        if self._sought is None or not counted:
            self._sought = candidates, compile_candidates(candidates, current.linear, self.arm)
        signatures = add_acting(self._sought[1], current, self.facts, refused, self.arm)
        self.parted = None  # frees many megabytes before the next one is made
        if current.findings:
            nothing = set_findings(current, [], self.arm)
            self.parted = PartedSurvey.from_fit(nothing, signatures, self.arm)
            scored = self.parted.with_findings(current)
        else:
            scored = score_candidates(make_projection(current, self.arm), signatures)
        if not counted:
            self.tests = max(int((scored.scores.freedom > 0).sum()), 1)
        self.work.add(scored.n_products, STEP_WORK)
        return scored

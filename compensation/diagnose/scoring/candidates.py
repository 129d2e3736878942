"""The scores of all candidates on one fit's residual; the findings' shapes absorb, too."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from armd.arrays import F64, I64, Mask
from armd.compensation.diagnose.constants import ROWS_A_COLUMN, SHAPE_PRIOR
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.rests import assign_folds
from armd.compensation.diagnose.problem.signatures import Signatures, compile_candidates
from armd.compensation.diagnose.scoring.evidence import (
    Scores,
    Sums,
    add_sums,
    estimate_amplitudes,
    score,
)
from armd.compensation.diagnose.scoring.projection import Projection, make_projection
from armd.compensation.diagnose.scoring.shape import is_shape, locate_shape, make_shape
from armd.compensation.diagnose.scoring.time_discrepancy import (
    has_unknown_initial_state,
    make_initial_state_candidate,
    make_slower,
)
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Candidate
from armd.compensation.model.arm import Arm


@dataclass(frozen=True)
class ScoredCandidates:
    """One fit's projection, and the products from which candidates are scored on its residual."""

    projection: Projection
    sums: Sums

    @property
    def fit(self) -> Fit:
        """The fit whose findings are in the model."""
        return self.projection.fit

    @property
    def n_products(self) -> float:
        """The number of products that scoring takes: of candidates' columns with shared ones and
        with rows.
        """
        columns, rows = self.sums.signatures.count.sum(), 3 * self.fit.linear.rests.n
        return float(columns) * (self.sums.shared.layout.n + rows / ROWS_A_COLUMN)

    @cached_property
    def scores(self) -> Scores:
        """The scores of all candidates, with the findings in the model.

        Parts of a finding are no candidates: a curve's amplitudes share one likely size, and what
        this leaves of the curve still belongs to it.
        """
        return score(self.sums).drop_candidates(
            np.any(self._parts, axis=0) | self._of_other_models()
        )

    def score_eligible_without(self, index: int) -> Scores:
        """Return the scores of all candidates, with one finding and its shape taken out of the
        model.
        """
        parts = np.delete(self._parts, index, axis=0)
        return self.score_without_finding(index).drop_candidates(
            np.any(parts, axis=0) | self._of_other_models(index)
        )

    def score_findings(self, index: int) -> Scores:
        """Score the findings themselves as candidates, with one of them taken out of the model."""
        return self._of_findings.score_without_finding(index)

    def score_findings_without_acting(self, index: int) -> Scores:
        """Score the findings as `score_findings` does, also without what acts through that finding.

        With that in the model, and with the start of a lag's sessions open, little would seem to be
        left of the finding through which it acts.
        """
        return self._of_findings.score_without_finding(
            index, *find_acting_through(self.fit.findings, index)
        )

    def score_without_finding(self, index: int, *acting: int) -> Scores:
        """Score all candidates without one finding, its shape, and others *acting* through it.

        Parts of the other findings are scored, too.
        """
        return score(self.sums, self._columns_of(index, *acting))

    def gain_of_shapes(self, index: int, candidates: Sequence[Candidate]) -> F64:
        """Return what *candidates* gain in log evidence if their own shapes may be off.

        One finding and its shape are taken out of the model; that finding's shape may be off, too.
        """
        with_shapes, gained = add_own_shapes(candidates, self.projection, self._columns_of(index))
        may_be_off = np.array(
            [b is not c for b, c in zip(with_shapes, candidates, strict=True)], dtype=bool
        )
        return np.where(may_be_off, np.logaddexp(0.0, gained), 0.0)

    def _columns_of(self, index: int, *acting: int) -> I64:
        """Return the shared columns of a finding, its shape, and others *acting* through it."""
        columns_by_finding = [
            self.projection.shapes.list_columns(self.fit, i) for i in (index, *acting)
        ]
        columns: I64 = self.projection.shared_number[np.concatenate(columns_by_finding)]
        return columns

    @cached_property
    def _of_findings(self) -> ScoredCandidates:
        return score_candidates(self.projection, self.fit.findings)

    def _of_other_models(self, index: int | None = None) -> Mask:
        """Return which candidates (C,) belong to another model than the one with these findings.

        They act through findings that are not in the model, or not through all that are. Or they
        may replace only a finding other than the one taken out.
        """
        candidates = self.sums.signatures.candidates
        is_barred = np.zeros(len(candidates), dtype=bool)
        places = {c.place for i, c in enumerate(self.fit.findings) if i != index}
        acting_candidates = [(i, c) for i, c in enumerate(candidates) if c.through is not None]
        for number, candidate in acting_candidates:
            if all(acting.candidate.place in places for acting in candidate.through or ()):
                alike = [i for i, c in acting_candidates if not c.through and c.is_like(candidate)]
                is_barred[alike if candidate.through else []] = True
            else:
                is_barred[number] = True
        taken_out = [] if index is None else [self.fit.findings[index]]
        for i in [i for i, c in enumerate(candidates) if c.instead_of]:
            candidate = candidates[i]
            is_barred[i] = not any(
                f.cause == candidate.instead_of or f.is_like(candidate) for f in taken_out
            )
        return is_barred

    @cached_property
    def _parts(self) -> Mask:
        """The candidates that are within a finding, (findings, C)."""
        candidates = self.sums.signatures.candidates
        parts = [[c.is_within(finding) for c in candidates] for finding in self.fit.findings]
        return np.array(parts, dtype=bool).reshape(len(parts), len(candidates))

    def log_posterior_of(self, index: int, scores: Scores) -> float:
        """Return the log posterior weight of a finding's place.

        A refined value may have more evidence than the grid's values. *scores* are those without
        the finding; they normalise the weight.
        """
        candidate = self.fit.findings[index]
        if is_shape(candidate):
            evidence = float(self.score_findings(index).log_evidence[index])
            return float(np.log(SHAPE_PRIOR)) + evidence - scores.log_total
        of_place = np.array([c.place == candidate.place for c in scores.signatures.candidates])
        if not np.isfinite(scores.log_evidence[of_place]).any():
            return -np.inf
        log_weight = float(logsumexp(scores.log_posterior()[of_place]))
        best = float(scores.log_evidence[of_place].max())
        evidence_own = float(self.score_findings(index).log_evidence[index])
        shape = next((c for c in self.fit.findings if c.location == locate_shape(candidate)), None)
        shape = shape or self.projection.shapes.candidates[index]
        if shape is not None:  # in the model or not, the shape belongs to the finding
            with_shape = _with_shape(candidate, shape)
            shaped_evidence = float(
                score_candidates(self.projection, [with_shape])
                .score_without_finding(index)
                .log_evidence[0]
            )
            evidence_own = float(np.logaddexp(evidence_own, shaped_evidence + np.log(SHAPE_PRIOR)))
        elif has_unknown_initial_state(candidate):
            evidence_own += float(self.gain_of_shapes(index, [candidate])[0])
        return log_weight + max(evidence_own - best, 0.0)


def add_own_shapes(
    candidates: Sequence[Candidate], projection: Projection, without: Iterable[int] = ()
) -> tuple[list[Candidate], F64]:
    """Return each candidate together with its shape, and (c,) the gain in log evidence.

    The shape is made at the amplitudes that the candidate has alone; a candidate without one is
    returned unchanged. The gain includes the shape's prior. The shared columns *without* are left
    out of the model. The shape of a lag is how its sessions began. With that open, the lag may be
    slower.
    """
    slower = [(i, s) for i, c in enumerate(candidates) for s in make_slower(c)]
    candidate_of = np.array([*range(len(candidates)), *(i for i, _ in slower)])
    every = [*candidates, *(s for _, s in slower)]
    straight = score_candidates(projection, every).sums
    amplitudes = estimate_amplitudes(straight, without)
    with_shapes = [
        _with_shape(c, _own_shape(c, values, projection))
        for c, values in zip(every, amplitudes, strict=True)
    ]
    free, straight_evidence = (
        score(sums, without).log_evidence
        for sums in (score_candidates(projection, with_shapes).sums, straight)
    )
    best = [
        max(np.flatnonzero(candidate_of == i), key=lambda k: free[k])
        for i in range(len(candidates))
    ]
    return [with_shapes[k] for k in best], free[best] - straight_evidence[: len(best)] + np.log(
        SHAPE_PRIOR
    )


def _own_shape(candidate: Candidate, amplitudes: F64, projection: Projection) -> Candidate | None:
    if has_unknown_initial_state(candidate):
        return make_initial_state_candidate(
            projection.fit.linear, candidate, amplitudes, projection.arm
        )
    return make_shape(candidate, amplitudes, projection.arm.n_joints)


def _with_shape(candidate: Candidate, shape: Candidate | None) -> Candidate:
    """Return a candidate together with its shape, if it has one.

    A cause may be many times its typical size. Its shape is off by at most a share of the cause: a
    shape that could be three times the cause would explain any signal of that joint.
    """
    if shape is None:
        return candidate
    shape_columns = (replace(column, reach=1.0) for column in shape.columns)
    return replace(candidate, columns=(*candidate.columns, *shape_columns))


def score_candidates(
    projection: Projection, candidates: Sequence[Candidate] | Signatures
) -> ScoredCandidates:
    """Score all *candidates*, compiled or not, by one pass over the rows."""
    if not isinstance(candidates, Signatures):
        candidates = compile_candidates(candidates, projection.fit.linear, projection.arm)
    return ScoredCandidates(projection, projection.sums(candidates))


@dataclass(frozen=True)
class PartedSurvey:
    """The whole catalogue about one fit without findings, summed by parts of the readings.

    All parts together, with the findings in the model, give the scores that the search uses.
    Without one part and without findings, they give the start of the search repeated on the other
    parts. Products of candidates' columns with what placements share are computed once for both.
    """

    projection: Projection
    sums: Sequence[Sums]  # of each part by itself

    @classmethod
    def from_fit(cls, fit: Fit, signatures: Signatures, arm: Arm) -> PartedSurvey:
        """Sum the catalogue about a *fit* without findings, by one pass over the rows."""
        projection = make_projection(fit, arm, assign_folds(fit.linear.rests))
        return cls(projection, projection.sums_by_part(signatures))

    @property
    def is_eliminated(self) -> Mask:
        """The nuisance columns, without findings, that are eliminated cell by cell (a mask)."""
        return self.projection.is_eliminated

    def without_findings(self, fit: Fit) -> ScoredCandidates:
        """Return the scores on all parts, under a *fit* without findings about the same point."""
        return ScoredCandidates(replace(self.projection, fit=fit), add_sums(self.sums))

    def with_findings(self, fit: Fit) -> ScoredCandidates:
        """Return the scores on all parts, with the findings of a *fit* about the same point in the
        model.
        """
        projection = self.projection.with_findings_of(fit)
        return ScoredCandidates(projection, projection.sums_with(add_sums(self.sums)))

    def without(self, part: int, fit: Fit) -> ScoredCandidates:
        """Return the scores on all parts but one.

        *fit*: without findings, of what placements share; its whitener is zero in that part.
        """
        remaining = [sums for i, sums in enumerate(self.sums) if i != part]
        return ScoredCandidates(self.projection.without(part, fit), add_sums(remaining))


def find_weakest(projection: Projection) -> tuple[int, float]:
    """Return the number of the least significant finding, and the log of its p value.

    Each finding is tested given all others but those that act through it. An exchange of sensors is
    as significant as the findings that go by the exchanged sensors: without it they would not be
    there.
    """
    findings = projection.fit.findings
    scored = score_candidates(projection, findings)
    log_p = []
    for i in range(len(findings)):
        acting = find_acting_through(findings, i)
        falling = [j for j in acting if CATALOGUE[findings[j].cause].by_temperature]
        freed = [(i, *acting), *((j, *find_acting_through(findings, j)) for j in falling)]
        log_p.append(
            min(
                float(scored.score_without_finding(*numbers).log_p[numbers[0]]) for numbers in freed
            )
        )
    weakest_index = int(np.argmax(log_p))
    return weakest_index, log_p[weakest_index]


def find_acting_through(findings: Sequence[Candidate], index: int) -> list[int]:
    """Return the numbers of the findings that act through another."""
    place = findings[index].place
    return [
        i
        for i, finding in enumerate(findings)
        if any(acting.candidate.place == place for acting in finding.through or ())
    ]

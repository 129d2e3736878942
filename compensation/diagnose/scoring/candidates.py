"""All candidates against what one fit leaves, the findings' shapes among what absorbs."""

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
    make_slower,
    make_unsettled,
    may_have_begun_anyhow,
)
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Candidate
from armd.compensation.model.arm import Arm


@dataclass(frozen=True)
class ScoredCandidates:
    """One fit's projection, and how strongly what it leaves wants each candidate."""

    projection: Projection
    sums: Sums

    @property
    def fit(self) -> Fit:
        """The fit whose findings are in the model."""
        return self.projection.fit

    @property
    def n_products(self) -> float:
        """Products of candidates' columns with shared ones, and with rows, that scoring takes."""
        columns, rows = self.sums.signatures.count.sum(), 3 * self.fit.linear.rests.n
        return float(columns) * (self.sums.shared.layout.n + rows / ROWS_A_COLUMN)

    @cached_property
    def scores(self) -> Scores:
        """Of all candidates, the findings in the model.

        What is left of a curve, held to a likely size, is the curve's: parts of a finding are no
        candidates beside it.
        """
        return score(self.sums).without(np.any(self._parts, axis=0) | self._of_other_models())

    def without(self, index: int) -> Scores:
        """Of all candidates, one finding and its shape taken out of the model."""
        parts = np.delete(self._parts, index, axis=0)
        return self.score_without_finding(index).without(
            np.any(parts, axis=0) | self._of_other_models(index)
        )

    def score_findings(self, index: int) -> Scores:
        """Of the findings themselves as candidates, one of them taken out of the model."""
        return self._of_findings.score_without_finding(index)

    def score_findings_without_acting(self, index: int) -> Scores:
        """The same, what acts through that finding taken out, too: with that in the model, and how
        a lag's sessions began open, little of what it acts through would seem to be there."""
        return self._of_findings.score_without_finding(
            index, *find_acting_through(self.fit.findings, index)
        )

    def score_without_finding(self, index: int, *acting: int) -> Scores:
        """Of all candidates, one finding and its shape taken out, and others *acting* through it;
        also of parts of the others."""
        return score(self.sums, self._columns_of(index, *acting))

    def gain_of_shapes(self, index: int, candidates: Sequence[Candidate]) -> F64:
        """What each of *candidates*, one finding and its shape taken out of the model, gains in log
        evidence if its own shape may be off, as that finding's may."""
        with_shapes, gained = add_own_shapes(candidates, self.projection, self._columns_of(index))
        may_be_off = np.array(
            [b is not c for b, c in zip(with_shapes, candidates, strict=True)], dtype=bool
        )
        return np.where(may_be_off, np.logaddexp(0.0, gained), 0.0)

    def _columns_of(self, index: int, *acting: int) -> I64:
        """Among the shared columns, those of a finding and its shape, and of others *acting*."""
        columns_by_finding = [self.projection.shapes.without(self.fit, i) for i in (index, *acting)]
        columns: I64 = self.projection.place[np.concatenate(columns_by_finding)]
        return columns

    @cached_property
    def _of_findings(self) -> ScoredCandidates:
        return score_candidates(self.projection, self.fit.findings)

    def _of_other_models(self, index: int | None = None) -> Mask:
        """(C,) which candidates act through findings that are not in the model, or not through all
        that are; and which may replace other findings than the one taken out."""
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
        """(findings, C) which candidates are within a finding."""
        candidates = self.sums.signatures.candidates
        parts = [[c.is_within(finding) for c in candidates] for finding in self.fit.findings]
        return np.array(parts, dtype=bool).reshape(len(parts), len(candidates))

    def log_posterior_of(self, index: int, scores: Scores) -> float:
        """Log posterior weight of a finding's place; a refined value may be better than its grid.

        *scores* are those without it, by which it is normalised.
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
        if shape is not None:  # in the model or not, it belongs to it
            with_shape = _with_shape(candidate, shape)
            shaped_evidence = float(
                score_candidates(self.projection, [with_shape])
                .score_without_finding(index)
                .log_evidence[0]
            )
            evidence_own = float(np.logaddexp(evidence_own, shaped_evidence + np.log(SHAPE_PRIOR)))
        elif may_have_begun_anyhow(candidate):
            evidence_own += float(self.gain_of_shapes(index, [candidate])[0])
        return log_weight + max(evidence_own - best, 0.0)


def add_own_shapes(
    candidates: Sequence[Candidate], projection: Projection, without: Iterable[int] = ()
) -> tuple[list[Candidate], F64]:
    """Each candidate together with its shape, about the amplitudes that it has alone, or itself
    where it has none; and (c,) what that gains in log evidence, its prior included. The shared
    columns *without* are left out of the model.

    The shape of a lag is how its sessions began. With that open, it may be a slower one.
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
    if may_have_begun_anyhow(candidate):
        return make_unsettled(projection.fit.linear, candidate, amplitudes, projection.arm)
    return make_shape(candidate, amplitudes, projection.arm.n_joints)


def _with_shape(candidate: Candidate, shape: Candidate | None) -> Candidate:
    """A candidate together with its shape, if it has one.

    A cause may be many times its typical size. Its shape is off by a share of it and no further: a
    shape that grew along, to three times the cause, would be any signal of that joint.
    """
    if shape is None:
        return candidate
    shape_columns = (replace(column, reach=1.0) for column in shape.columns)
    return replace(candidate, columns=(*candidate.columns, *shape_columns))


def score_candidates(
    projection: Projection, candidates: Sequence[Candidate] | Signatures
) -> ScoredCandidates:
    """One pass over the rows with all *candidates*, compiled or not."""
    if not isinstance(candidates, Signatures):
        candidates = compile_candidates(candidates, projection.fit.linear, projection.arm)
    return ScoredCandidates(projection, projection.sums(candidates))


@dataclass(frozen=True)
class PartedSurvey:
    """The whole catalogue about one fit without findings, summed by parts of the readings.

    All parts together, with the findings in the model, are the survey that the search looks at.
    Without one of them and without findings it is where the search repeated on the others begins.
    The products of all candidates' columns with what placements share are worked out once for both.
    """

    projection: Projection
    sums: Sequence[Sums]  # of each part by itself

    @classmethod
    def from_fit(cls, fit: Fit, signatures: Signatures, arm: Arm) -> PartedSurvey:
        """Of a *fit* without findings, by one pass over the rows."""
        projection = make_projection(fit, arm, assign_folds(fit.linear.rests))
        return cls(projection, projection.sums_by_part(signatures))

    @property
    def is_eliminated(self) -> Mask:
        """Which of the nuisance columns without findings are eliminated, cell by cell."""
        return self.projection.is_eliminated

    def without_findings(self, fit: Fit) -> ScoredCandidates:
        """All parts, under a *fit* without findings about the same point."""
        return ScoredCandidates(replace(self.projection, fit=fit), add_sums(self.sums))

    def with_findings(self, fit: Fit) -> ScoredCandidates:
        """All parts, with the findings of the *fit*, which is about the same point, in the
        model."""
        projection = self.projection.with_findings_of(fit)
        return ScoredCandidates(projection, projection.sums_with(add_sums(self.sums)))

    def without(self, part: int, fit: Fit) -> ScoredCandidates:
        """All parts but one, for a *fit* without findings of what placements share, whose whitener
        is zero there."""
        remaining = [sums for i, sums in enumerate(self.sums) if i != part]
        return ScoredCandidates(self.projection.without(part, fit), add_sums(remaining))


def find_weakest(projection: Projection) -> tuple[int, float]:
    """The least significant of the findings, each beside all others but those that act through it:
    its number, and the log of its p value. An exchange is as significant as what goes by the
    exchanged sensors, and would not be there without."""
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
    """Numbers of the findings that act through another."""
    place = findings[index].place
    return [
        i
        for i, finding in enumerate(findings)
        if any(acting.candidate.place == place for acting in finding.through or ())
    ]

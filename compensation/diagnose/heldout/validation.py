"""The choice of findings for the extended calibration: those that held-out readings validate.

A finding is significant on the readings that it was found in. Only other readings can show whether
the model is better with it. Findings join one after another, in the order in which they were found,
where the held-out error falls significantly. One that helps only together with a later one is tried
again.

The cost and the benefit: a worthless finding passes once in forty (the interval has 2.5 % below
zero), and then only by its chance gain. A true one of five noise units mostly passes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Final

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.constants import IN_ONE, LEAST_POSITIVE, TARGET_FOLDS
from armd.compensation.diagnose.diagnosis import (
    Gain,
    JudgedBy,
    SearchResult,
    ValidatedFindings,
)
from armd.compensation.diagnose.extend import extend_calibration, has_known_growth
from armd.compensation.diagnose.fitting.follow import follow_solution
from armd.compensation.diagnose.fitting.neighbourhood import compute_scale_factor
from armd.compensation.diagnose.fitting.refit import Refits
from armd.compensation.diagnose.heldout.fold_residuals import make_squares_in_turn
from armd.compensation.diagnose.heldout.gain import group_readings
from armd.compensation.diagnose.heldout.judge import HoldoutScheme, IsUninformative, Judge
from armd.compensation.diagnose.heldout.later_readings import make_later_squares
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.rests import assign_folds
from armd.compensation.diagnose.scoring.shape import is_shape, locate_shape
from armd.compensation.effects.by_session import is_by_session
from armd.compensation.effects.courses import is_drift, is_slow
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.observations import Observations
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.arm import Arm

TARGETS: Final = "targets left out within placements"


def choose_validated_findings(
    result: SearchResult,
    schemes: Sequence[HoldoutScheme],
    able: Sequence[bool],
    is_uninformative: IsUninformative = lambda _finding, _numbers: False,
    later: Callable[[Sequence[int], bool], F64] | None = None,
    growth: bool = False,
    cannot_see_growth: bool = False,
    repeated_tells: bool = True,
) -> ValidatedFindings:
    """Choose those of the findings *able* to be written that held-out readings validate.

    The first scheme decides. But a finding that shows in one placement only cannot be learnt from
    the others. Where the first scheme does not contradict a finding, or *is_uninformative* about
    it, a further scheme may validate it. A finding that depends on time or temperature must also
    not make *later* readings worse: their squared residuals by findings, predicted from earlier
    ones.

    The findings were fitted together with the first link's expansion (*growth*). Where all readings
    determine it well, the findings are judged with it, and it is written, too, if it is validated
    given them. If the first scheme cannot show it (*cannot_see_growth*), the findings are judged
    without it, and it joins where the last scheme predicts better with it.

    Gains are those of the repeated search, unless this is uninformative (*repeated_tells*).
    """
    judge = Judge(result.last, schemes, is_uninformative, later)
    if growth and not cannot_see_growth:
        with_growth = _choose_validated(result, judge, able, True, repeated_tells)
        if with_growth.numbers and judge.find_confirming_scheme(
            (with_growth.numbers, False), (with_growth.numbers, True)
        ):
            return with_growth
    chosen = _choose_validated(result, judge, able, False, repeated_tells)
    if growth and cannot_see_growth and chosen.numbers:
        with_growth = replace(chosen, growth=judge.predicts_better_with_growth(chosen.numbers))
        if with_growth.growth and chosen.by == TARGETS:  # the scheme that shows it has decided
            with_growth = replace(with_growth, after=judge.errors((chosen.numbers, True))[-1])
        return with_growth
    return chosen


def _choose_validated(
    result: SearchResult, judge: Judge, able: Sequence[bool], growth: bool, repeated_tells: bool
) -> ValidatedFindings:
    """Choose findings that are validated one after another, in a model with *growth* or without.

    *growth*: whether the first link expands. The comparison starts from the model under test, which
    has no such expansion.
    """
    chosen: tuple[int, ...] = ()
    further: dict[int, Gain] = {}
    contradicted: list[int] = []
    every = tuple(i for i, ok in enumerate(able) if ok)
    has_joined = True
    while has_joined:
        has_joined = False
        for i in every:
            if i in chosen or not _has_its_cause(result.last, i, chosen):
                continue
            tried = tuple(sorted((*chosen, i)))
            confirmed = judge.find_confirming_scheme((chosen, growth), (tried, growth))
            if confirmed is not None:
                if not judge.predicts_later_no_worse((chosen, growth), (tried, growth)):
                    contradicted.append(i)
                    continue
                chosen, has_joined = tried, True
                if confirmed[0] > 0:
                    further[i] = confirmed[1]
    current, full = (chosen, growth), (every, growth)
    together = judge.find_confirming_scheme(current, full) if len(every) > len(chosen) + 1 else None
    if together is not None and judge.predicts_later_no_worse(current, full):
        chosen = _remove_harmful(result.last, judge, every, growth)  # some help only together
    decides = -1 if further else 0
    contradicted_later = tuple(i for i in dict.fromkeys(contradicted) if i not in chosen)
    doubts = {
        i: judge.compute_odds_factor(i, (chosen, growth), (tuple(sorted((*chosen, i))), growth))
        for i in every
        if i not in chosen
    }
    gains = further
    by: JudgedBy = TARGETS if further else ""
    if chosen and not repeated_tells:
        by = by or "placements left out"
        gains = {i: judge.compute_gain_of(i, chosen, growth) for i in chosen} | further
    growth = growth and bool(chosen)
    before, after = (judge.errors(model)[decides] for model in (((), False), (chosen, growth)))
    return ValidatedFindings(chosen, before, after, gains, by, contradicted_later, growth, doubts)


def _remove_harmful(
    last: Fit, judge: Judge, every: tuple[int, ...], growth: bool
) -> tuple[int, ...]:
    """Remove from findings validated together those without which the others predict better.

    The last found is tried first. A set that helps must not include findings that harm.
    """
    remaining = every
    for i in reversed(every):
        tried = tuple(j for j in remaining if j != i)
        causes = all(_has_its_cause(last, j, tried) for j in tried)
        if tried and causes and judge.is_harmful(i, (tried, growth), (remaining, growth)):
            remaining = tried
    return remaining


def validate_by_placement(
    result: SearchResult, arm: Arm, stepwise: Sequence[Gain]
) -> ValidatedFindings:
    """Validate findings on whole placements held out in turn, then on targets within placements.

    *stepwise*: gains of the search repeated without the placements.
    """
    last = result.last
    rests, points = last.linear.rests, last.linear.rests.points
    groups = group_readings(points)
    schemes = [
        HoldoutScheme(make_squares_in_turn(last, arm, folds), groups, float(points.freedom.mean()))
        for folds in (assign_folds(rests), _assign_folds_by_target(points)[rests.point_of])
    ]
    able = [not finding.candidate.is_report_only for finding in result.findings]
    later = make_later_squares(last, arm) if any(map(may_go_on_otherwise, last.findings)) else None
    growth = has_known_growth(last, arm)
    cannot_see_growth = growth and _is_in_one_fold(last, last.net_growth())
    repeated_tells = not stepwise or stepwise[-1].after_um <= stepwise[0].before_um
    return choose_validated_findings(
        result,
        schemes,
        able,
        _make_uninformative_by_placement(last),
        later,
        growth,
        cannot_see_growth,
        repeated_tells,
    )


def may_go_on_otherwise(candidate: Candidate) -> bool:
    """Whether a candidate's course after the readings is unknown.

    It is a drift, it has a separate value in each session, or it has no name and depends on time or
    temperature.
    """
    nameless = candidate.cause == "unknown" and is_slow(candidate)
    return nameless or is_drift(candidate) or is_by_session(candidate)


def _make_uninformative_by_placement(last: Fit) -> IsUninformative:
    """Make the test whether held-out placements cannot show a finding, given *numbers* in the
    model.

    Another finding that is not among these may absorb what most placements show of it.
    """
    refits = Refits(last)

    @cache
    def is_uninformative(finding: int, numbers: tuple[int, ...]) -> bool:
        return _is_in_one_fold(
            last, refits.with_subset(numbers).net_signature(numbers.index(finding))
        )

    return is_uninformative


def _is_in_one_fold(last: Fit, moves: F64) -> bool:
    """Whether nearly all of what *moves* (n, 3) the tip is in placements of one fold."""
    white = last.noise.whiten_rests(moves)
    by_fold = np.bincount(assign_folds(last.linear.rests), (white**2).sum(axis=1))
    return bool(by_fold.max() > IN_ONE * max(float(by_fold.sum()), LEAST_POSITIVE))


def _assign_folds_by_target(observations: Observations) -> I64:
    """Return the fold of each reading: by its target or, of readings with truth, by its posture."""
    turn = np.where(observations.has_truth, observations.posture, observations.target)
    folds: I64 = turn % TARGET_FOLDS
    return folds


def validate_by_session(
    result: SearchResult,
    arm: Arm,
    sessions: Sequence[Session],
    holdout: Sequence[Session],
    readings: Observations,
) -> ValidatedFindings:
    """Validate findings on held-out sessions; *readings*: those of them that can be judged."""
    last = result.last
    refit = Refits(last)

    def squares(numbers: Sequence[int], growth: bool) -> F64:
        return compute_squares_on_sessions(
            refit.with_subset(numbers), arm, sessions, holdout, growth
        )

    scheme = HoldoutScheme(squares, group_readings(readings), float(readings.freedom.mean()))
    able = [not finding.candidate.is_report_only for finding in result.findings]
    return choose_validated_findings(result, [scheme], able, growth=has_known_growth(last, arm))


def compute_squares_on_sessions(
    step: Fit,
    arm: Arm,
    sessions: Sequence[Session],
    holdout: Sequence[Session],
    growth: bool,
) -> F64:
    """Return squared residuals (n,) mm² of the *holdout*'s readings, under *step*'s model."""
    model = step.baseline.calibration
    if step.findings:
        model = extend_calibration(follow_solution(step, arm), arm, sessions, growth=growth)
    residual = evaluate(holdout, arm, model).residual_mm
    squares: F64 = (residual**2).sum(axis=1) * compute_scale_factor(step, arm) ** 2
    return squares


def _has_its_cause(last: Fit, index: int, chosen: Sequence[int]) -> bool:
    """Whether a finding can be written: a shape only with the finding whose shape it is."""
    finding = last.findings[index]
    if not is_shape(finding):
        return True
    return any(locate_shape(last.findings[i]) == finding.location for i in chosen)

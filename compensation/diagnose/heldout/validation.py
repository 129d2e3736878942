"""Which findings the extended calibration gets: those that held-out readings validate.

A finding is significant on the readings it was made of; whether the model is better with it, only
others can tell. Findings join one after another, in the order in which they were found, where the
held-out error falls beyond doubt; one that helps only beside a later one gets its turn again.

What this costs and saves: a finding that is worth nothing passes once in forty (the interval has
2.5 % below zero), and then by what chance made of it; a true one of five noise units passes mostly.
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
from armd.compensation.diagnose.heldout.gain import group_readings
from armd.compensation.diagnose.heldout.judge import IsUninformative, Judge, Look
from armd.compensation.diagnose.heldout.later_readings import make_later_squares
from armd.compensation.diagnose.heldout.sets import make_squares_in_turn
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


def choose(
    result: SearchResult,
    looks: Sequence[Look],
    able: Sequence[bool],
    is_uninformative: IsUninformative = lambda _finding, _numbers: False,
    later: Callable[[Sequence[int], bool], F64] | None = None,
    growth: bool = False,
    cannot_see_growth: bool = False,
    repeated_tells: bool = True,
) -> ValidatedFindings:
    """Those of the findings *able* to be written that held-out readings bear out.

    The first look decides. What shows in one placement only, nobody can learn from the others:
    where the first look does not speak against a finding, or *is_uninformative* on it, a further
    one may bear it out. Nor must a drift make *later* readings worse, or beside one what goes with
    temperature: their squared residuals by findings, predicted from earlier ones.

    The findings were fitted beside the first link's *growth*. Where all readings tell that beyond
    doubt, findings are judged with it, and it is written too if that is borne out beside them. A
    first look that cannot see it (*cannot_see_growth*) judges them without; then it joins where
    the next look predicts better so.

    Gains are the repeated search's, unless it tells nothing (*repeated_tells*).
    """
    judge = Judge(result.last, looks, is_uninformative, later)
    if growth and not cannot_see_growth:
        with_growth = _choose_validated(result, judge, able, True, repeated_tells)
        if with_growth.numbers and judge.find_confirming_look(
            (with_growth.numbers, False), (with_growth.numbers, True)
        ):
            return with_growth
    chosen = _choose_validated(result, judge, able, False, repeated_tells)
    if growth and cannot_see_growth and chosen.numbers:
        with_growth = replace(chosen, growth=judge.predicts_better(chosen.numbers))
        if with_growth.growth and chosen.by == TARGETS:  # the look that hears it has decided
            with_growth = replace(with_growth, after=judge.errors((chosen.numbers, True))[-1])
        return with_growth
    return chosen


def _choose_validated(
    result: SearchResult, judge: Judge, able: Sequence[bool], growth: bool, repeated_tells: bool
) -> ValidatedFindings:
    """The findings borne out one after another, in a model in which the first link grows or not;
    beside the model under test, which is silent on that."""
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
            confirmed = judge.find_confirming_look((chosen, growth), (tried, growth))
            if confirmed is not None:
                if not judge.predicts_later_no_worse((chosen, growth), (tried, growth)):
                    contradicted.append(i)
                    continue
                chosen, has_joined = tried, True
                if confirmed[0] > 0:
                    further[i] = confirmed[1]
    current, full = (chosen, growth), (every, growth)
    together = judge.find_confirming_look(current, full) if len(every) > len(chosen) + 1 else None
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
    """Of findings borne out together, those that the rest does not predict better without, the
    last found asked first: a set that helps must not carry along what harms."""
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
    """By whole placements left out in turn, then by targets within them; *stepwise*: gains of a
    search repeated without the placements."""
    last = result.last
    rests, points = last.linear.rests, last.linear.rests.points
    groups = group_readings(points)
    looks = [
        Look(make_squares_in_turn(last, arm, folds), groups, float(points.freedom.mean()))
        for folds in (assign_folds(rests), _assign_folds_by_target(points)[rests.point_of])
    ]
    able = [not finding.candidate.is_report_only for finding in result.findings]
    later = make_later_squares(last, arm) if any(map(may_go_on_otherwise, last.findings)) else None
    growth = has_known_growth(last, arm)
    cannot_see_growth = growth and _is_in_one_fold(last, last.net_growth())
    repeated_tells = not stepwise or stepwise[-1].after_um <= stepwise[0].before_um
    return choose(
        result,
        looks,
        able,
        _make_uninformative_by_placement(last),
        later,
        growth,
        cannot_see_growth,
        repeated_tells,
    )


def may_go_on_otherwise(candidate: Candidate) -> bool:
    """Whether nobody knows how it goes on after the readings: a drift, what each session has a
    value of its own of, what goes with time or temperature and has no name."""
    nameless = candidate.cause == "unknown" and is_slow(candidate)
    return nameless or is_drift(candidate) or is_by_session(candidate)


def _make_uninformative_by_placement(last: Fit) -> IsUninformative:
    """Whether placements left out cannot tell of a finding: beside the findings that it is judged
    with. Another that is not among them may take up what most placements show of it."""
    refits = Refits(last)

    @cache
    def is_uninformative(finding: int, numbers: tuple[int, ...]) -> bool:
        return _is_in_one_fold(
            last, refits.with_subset(numbers).net_signature(numbers.index(finding))
        )

    return is_uninformative


def _is_in_one_fold(last: Fit, moves: F64) -> bool:
    """Whether nearly all of what *moves* (n, 3) the tip does so in placements left out together."""
    white = last.noise.whiten_rests(moves)
    by_fold = np.bincount(assign_folds(last.linear.rests), (white**2).sum(axis=1))
    return bool(by_fold.max() > IN_ONE * max(float(by_fold.sum()), LEAST_POSITIVE))


def _assign_folds_by_target(observations: Observations) -> I64:
    """Fold of each rest: its target's within the placement; of readings with truth their
    posture's turn."""
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
    """By sessions that had no part in anything; *readings*: those of them that can be judged."""
    last = result.last
    refit = Refits(last)

    def squares(numbers: Sequence[int], growth: bool) -> F64:
        return compute_squares_on_sessions(
            refit.with_subset(numbers), arm, sessions, holdout, growth
        )

    look = Look(squares, group_readings(readings), float(readings.freedom.mean()))
    able = [not finding.candidate.is_report_only for finding in result.findings]
    return choose(result, [look], able, growth=has_known_growth(last, arm))


def compute_squares_on_sessions(
    step: Fit,
    arm: Arm,
    sessions: Sequence[Session],
    holdout: Sequence[Session],
    growth: bool,
) -> F64:
    """Squared residuals (n,) mm² of the *holdout*'s readings under the model written of *step*."""
    model = step.baseline.calibration
    if step.findings:
        model = extend_calibration(follow_solution(step, arm), arm, sessions, growth=growth)
    residual = evaluate(holdout, arm, model).residual_mm
    squares: F64 = (residual**2).sum(axis=1) * compute_scale_factor(step, arm) ** 2
    return squares


def _has_its_cause(last: Fit, index: int, chosen: Sequence[int]) -> bool:
    """A shape is written with the finding whose shape it is, or not at all."""
    finding = last.findings[index]
    if not is_shape(finding):
        return True
    return any(locate_shape(last.findings[i]) == finding.location for i in chosen)

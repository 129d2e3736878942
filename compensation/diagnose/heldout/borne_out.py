"""Which findings the extended calibration gets: those that readings held out bear out.

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
from armd.compensation.data.session import Session
from armd.compensation.diagnose.constants import IN_ONE, LEAST_POSITIVE, SURE_P, TARGET_FOLDS
from armd.compensation.diagnose.diagnosis import BorneOut, Finding, Gain, JudgedBy, SearchResult
from armd.compensation.diagnose.extend import extended, knows_growth
from armd.compensation.diagnose.fitting.follow import follow_solution
from armd.compensation.diagnose.fitting.neighbourhood import scale_kept
from armd.compensation.diagnose.fitting.refit import Refits
from armd.compensation.diagnose.heldout.forward import later_squares
from armd.compensation.diagnose.heldout.gain import groups_of
from armd.compensation.diagnose.heldout.judge import Deaf, Judge, Look
from armd.compensation.diagnose.heldout.sets import left_out_in_turn
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.rests import folds_of
from armd.compensation.diagnose.scoring.shape import is_shape, shape_place
from armd.compensation.effects.by_session import is_by_session
from armd.compensation.effects.courses import is_drift, is_slow
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.postures import find_postures
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.arm import Arm

TARGETS: Final = "targets left out within placements"


def choose(
    result: SearchResult,
    looks: Sequence[Look],
    able: Sequence[bool],
    deaf: Deaf = lambda _finding, _some: False,
    later: Callable[[Sequence[int], bool], F64] | None = None,
    growth: bool = False,
    deaf_to_growth: bool = False,
    repeated_tells: bool = True,
) -> BorneOut:
    """Those of the findings *able* to be written that held-out readings bear out.

    The first look decides. What shows in one placement only, nobody can learn from the others:
    where the first look does not speak against a finding, or is *deaf* to it, a further one may
    bear it out. Nor must a drift make *later* readings worse, or beside one what goes with
    temperature: their squared residuals by findings, predicted from earlier ones.

    The findings were fitted beside the first link's *growth*. Where all readings tell that beyond
    doubt, findings are judged with it, and it is written too if that is borne out beside them. A
    first look that is deaf to it judges them without; then it joins where the next look predicts
    better so.

    Gains are the repeated search's, unless it tells nothing (*repeated_tells*).
    """
    judge = Judge(result.last, looks, deaf, later)
    if growth and not deaf_to_growth:
        with_it = _chosen(result, judge, able, True, repeated_tells)
        if with_it.some and judge.shown_by((with_it.some, False), (with_it.some, True)):
            return with_it
    chosen = _chosen(result, judge, able, False, repeated_tells)
    if growth and deaf_to_growth and chosen.some:
        with_it = replace(chosen, growth=judge.predicts_better(chosen.some))
        if with_it.growth and chosen.by == TARGETS:  # the look that hears it has decided
            with_it = replace(with_it, after=judge.errors((chosen.some, True))[-1])
        return with_it
    return chosen


def _chosen(
    result: SearchResult, judge: Judge, able: Sequence[bool], growth: bool, repeated_tells: bool
) -> BorneOut:
    """The findings borne out one after another, in a model in which the first link grows or not;
    beside the model under test, which is silent on that."""
    chosen: tuple[int, ...] = ()
    further: dict[int, Gain] = {}
    unforeseen: list[int] = []
    every = tuple(i for i, ok in enumerate(able) if ok)
    more = True
    while more:
        more = False
        for i in every:
            if i in chosen or not _has_its_cause(result.last, i, chosen):
                continue
            some = tuple(sorted((*chosen, i)))
            if (shown := judge.shown_by((chosen, growth), (some, growth))) is not None:
                if not judge.foreseen((chosen, growth), (some, growth)):
                    unforeseen.append(i)
                    continue
                chosen, more = some, True
                if shown[0] > 0:
                    further[i] = shown[1]
    now, whole = (chosen, growth), (every, growth)
    together = judge.shown_by(now, whole) if len(every) > len(chosen) + 1 else None
    if together is not None and judge.foreseen(now, whole):
        chosen = _without_harm(result.last, judge, every, growth)  # some help only together
    decides = -1 if further else 0
    told = tuple(i for i in dict.fromkeys(unforeseen) if i not in chosen)
    doubts = {
        i: judge.doubt(i, (chosen, growth), (tuple(sorted((*chosen, i))), growth))
        for i in every
        if i not in chosen
    }
    gains = further
    by: JudgedBy = TARGETS if further else ""
    if chosen and not repeated_tells:
        by = by or "placements left out"
        gains = {i: judge.gain_of(i, chosen, growth) for i in chosen} | further
    growth = growth and bool(chosen)
    before, after = (judge.errors(model)[decides] for model in (((), False), (chosen, growth)))
    return BorneOut(chosen, before, after, gains, by, told, growth, doubts)


def _without_harm(last: Fit, judge: Judge, every: tuple[int, ...], growth: bool) -> tuple[int, ...]:
    """Of findings borne out together, those that the rest does not predict better without, the
    last found asked first: a set that helps must not carry along what harms."""
    kept = every
    for i in reversed(every):
        some = tuple(j for j in kept if j != i)
        causes = all(_has_its_cause(last, j, some) for j in some)
        if some and causes and judge.harmful(i, (some, growth), (kept, growth)):
            kept = some
    return kept


def by_placement(result: SearchResult, arm: Arm, stepwise: Sequence[Gain]) -> BorneOut:
    """By whole placements left out in turn, then by targets within them; *stepwise*: gains of a
    search repeated without the placements."""
    last = result.last
    rests, points = last.linear.rests, last.linear.rests.points
    groups = groups_of(points)
    looks = [
        Look(left_out_in_turn(last, arm, folds), groups, float(points.freedom.mean()))
        for folds in (folds_of(rests), _by_target(points)[rests.point_of])
    ]
    able = [
        not found.candidate.told_only and stands_alone(found, step)
        for found, step in zip(result.found, stepwise, strict=True)
    ]
    later = later_squares(last, arm) if any(map(may_go_on_otherwise, last.findings)) else None
    growth = knows_growth(last, arm)
    deaf_to_growth = growth and _in_one_fold(last, last.net_growth())
    repeated_tells = not stepwise or stepwise[-1].after_um <= stepwise[0].before_um
    return choose(
        result, looks, able, _deaf_by_placement(last), later, growth, deaf_to_growth, repeated_tells
    )


def may_go_on_otherwise(candidate: Candidate) -> bool:
    """Whether nobody knows how it goes on after the readings: a drift, what each session has a
    value of its own of, what goes with time or temperature and has no name."""
    nameless = candidate.cause == "unknown" and is_slow(candidate)
    return nameless or is_drift(candidate) or is_by_session(candidate)


def stands_alone(found: Finding, step: Gain) -> bool:
    """Whether placements left out may bear a finding out: one so sure that it was not chosen for
    them, or one whose own *step* of the repeated search predicts no worse than the step before."""
    sure = found.p_value < SURE_P and found.candidate.cause != "unknown"
    return sure or step.after_um <= step.before_um


def _deaf_by_placement(last: Fit) -> Deaf:
    """Whether placements left out cannot tell of a finding: beside the findings that it is judged
    with. Another that is not among them may take up what most placements show of it."""
    refits = Refits(last)

    @cache
    def deaf(finding: int, some: tuple[int, ...]) -> bool:
        return _in_one_fold(last, refits.with_subset(some).net_signature(some.index(finding)))

    return deaf


def _in_one_fold(last: Fit, moves: F64) -> bool:
    """Whether nearly all of what *moves* (n, 3) the tip does so in placements left out together."""
    white = last.noise.whiten_rests(moves)
    told = np.bincount(folds_of(last.linear.rests), (white**2).sum(axis=1))
    return bool(told.max() > IN_ONE * max(float(told.sum()), LEAST_POSITIVE))


def _by_target(observations: Observations) -> I64:
    """Fold of each rest: its target's within the placement; of readings with truth their
    posture's turn."""
    turn = np.where(observations.has_truth, find_postures(observations), observations.target)
    folds: I64 = turn % TARGET_FOLDS
    return folds


def by_session(
    result: SearchResult,
    arm: Arm,
    sessions: Sequence[Session],
    holdout: Sequence[Session],
    readings: Observations,
) -> BorneOut:
    """By sessions that had no part in anything; *readings*: those of them that can be judged."""
    last = result.last
    refit = Refits(last)

    def squares(some: Sequence[int], growth: bool) -> F64:
        return on_sessions(refit.with_subset(some), arm, sessions, holdout, growth)

    look = Look(squares, groups_of(readings), float(readings.freedom.mean()))
    able = [not found.candidate.told_only for found in result.found]
    return choose(result, [look], able, growth=knows_growth(last, arm))


def on_sessions(
    step: Fit,
    arm: Arm,
    sessions: Sequence[Session],
    holdout: Sequence[Session],
    growth: bool,
) -> F64:
    """Squared residuals (n,) mm² of the *holdout*'s readings under the model written of *step*."""
    model = step.baseline.calibration
    if step.findings:
        model = extended(follow_solution(step, arm), arm, sessions, growth=growth)
    residual = evaluate(holdout, arm, model).residual_mm
    square: F64 = (residual**2).sum(axis=1) * scale_kept(step, arm) ** 2
    return square


def _has_its_cause(last: Fit, index: int, chosen: Sequence[int]) -> bool:
    """A shape is written with the finding whose shape it is, or not at all."""
    finding = last.findings[index]
    if not is_shape(finding):
        return True
    return any(shape_place(last.findings[i]) == finding.location for i in chosen)

"""The plan of the next check: poses on two seats that determine the cause of a doubtful change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from armd.arrays import F64
from armd.compensation.interim.changes.change import Change
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.evidence.stack import Stack, join_checks
from armd.compensation.interim.report.amend import list_telling_checks
from armd.compensation.interim.report.discrimination import (
    choose_best_poses,
    compute_overlap,
    estimate_chance_wrong,
    group_by_place,
    list_all_scenarios,
    list_numbers,
    predict_checks,
)
from armd.compensation.interim.report.judgement import Epoch, Judgement
from armd.compensation.interim.report.possible_checks import plan_check, predict_check, select_rows
from armd.compensation.interim.report.result import name_cause
from armd.compensation.model.slow_factors import DAY_S
from armd.compensation.model.state import States
from armd.compensation.wording import format_plain

#: The number of seats of a check, of poses in all, and of the best pairs of seats for which poses
#: are chosen one by one.
SEATS, POSES, TRIED = 2, 12, 3
#: A cause of this probability needs no check of its own.
SURE = 0.95
#: A planned check must reduce the probability of a wrong cause below this share of that after the
#: usual check.
MOST_REMAINING_RISK = 0.9


@dataclass(frozen=True)
class AdvisedPoses:
    """Poses on the seats in turn, with the probability that the likeliest cause is wrong.

    It is stated now, and predicted after the usual check and after this one.
    """

    seats_mm: F64  # (S, 3) base frame
    states: States
    now: float
    after_usual: float
    after_this: float

    @property
    def approach(self) -> list[str]:
        """One string for each pose: the signs of the senses in which the joints turn before they
        rest.
        """
        return ["".join("+" if v > 0 else "-" for v in rate) for rate in self.states.rate]


@dataclass(frozen=True)
class NextCheck:
    """The next check: a sentence, and poses if any are advised."""

    sentence: str
    advised: AdvisedPoses | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the check as the result contains it."""
        entry: dict[str, Any] = {"sentence": self.sentence}
        entry |= {"seats_mm": [], "poses_deg": [], "approach": []}
        if self.advised is not None:
            entry["seats_mm"] = self.advised.seats_mm.round(1).tolist()
            entry["poses_deg"] = np.degrees(self.advised.states.q).round(1).tolist()
            entry["approach"] = self.advised.approach
            entry["chance_wrong"] = {
                key: round(float(getattr(self.advised, key)), 4)
                for key in ("now", "after_usual", "after_this")
            }
        return entry


def plan_next_check(judgement: Judgement) -> NextCheck:
    """Plan the check that settles the most doubtful change of the latest epoch."""
    if not judgement.changed:
        return NextCheck("the usual check, in other poses than today's")
    epoch = judgement.latest
    doubtful = [
        (reported.change.probability, index)
        for index, reported in enumerate(epoch.reported_changes)
        if reported.cause is not None and reported.change.probability < SURE
    ]
    with threadpool_limits(limits=1, user_api="blas"):
        for _, index in sorted(doubtful):
            advice = plan_separating_check(epoch, index)
            if advice is not None:
                return advice
    return NextCheck(
        "the usual check, with the corrected calibration: it confirms that nothing else has changed"
    )


def plan_separating_check(epoch: Epoch, index: int) -> NextCheck | None:
    """Plan poses on seats that determine the cause of change number *index*.

    Returns None if no poses do clearly better than the usual check.
    """
    share, scenarios = group_by_place(epoch.scenarios, epoch.causes, index)
    last = epoch.checks[-1]
    arm, calibration = last.arm, last.calibration.content
    check_unix_s = last.reduced.last_unix_s + epoch.stack.gap_d * DAY_S
    plan = plan_check(arm, calibration, check_unix_s)
    if len(share) < 2 or len(plan.seats_mm) < SEATS:
        return None
    checks = [check.reduced for check in epoch.checks]
    measured = list_telling_checks(epoch.stack, epoch.detected.changes, epoch.detected.bad)
    again = checks[measured[-1]]  # its seats are already projected out
    usual = replace(again, mean_unix_s=check_unix_s, targets=np.zeros((len(again.residual), 0)))
    every_pose = predict_check(plan, arm, calibration, epoch.causes)
    stacked = _stack_with(epoch, [*checks, every_pose])
    (ahead,) = predict_checks(stacked, scenarios, measured, [len(checks)])
    pairs = list(combinations(range(len(plan.seats_mm)), SEATS))
    pools = [[plan.list_poses_on(seat) for seat in pair] for pair in pairs]
    pool_overlaps = [
        float(compute_overlap(share, ahead.rows(list_numbers(np.concatenate(p))))) for p in pools
    ]
    tried = [
        (*choose_best_poses(share, ahead, pools[k], POSES), k)
        for k in np.argsort(pool_overlaps)[:TRIED]
    ]
    chosen, _, best = min(tried, key=lambda attempt: attempt[1])
    poses = np.array(chosen)
    this = select_rows(every_pose, list_numbers(poses))
    stacked = _stack_with(epoch, [*checks, usual, this])
    reported = epoch.reported_changes[index]
    assert reported.cause is not None
    probability_of = {reported.cause.place: reported.change.probability}
    probability_of |= {rival.place: probability for rival, probability in reported.rivals}
    shares, of_scenario, all_scenarios = list_all_scenarios(
        epoch.scenarios, epoch.causes, index, probability_of
    )
    next_ones = predict_checks(stacked, all_scenarios, measured, range(len(checks), stacked.n))
    after_usual, after_this = (
        estimate_chance_wrong(shares, of_scenario, predicted) for predicted in next_ones
    )
    advised = AdvisedPoses(
        seats_mm=plan.seats_mm[list(pairs[best])],
        states=plan.states.rows(poses),
        now=1.0 - reported.change.probability,
        after_usual=after_usual,
        after_this=after_this,
    )
    if advised.after_this > MOST_REMAINING_RISK * advised.after_usual:
        return None
    return NextCheck(
        _write_sentence(
            advised, [name_cause(epoch.causes[k]) for k in _list_causes(scenarios, index)]
        ),
        advised,
    )


def _stack_with(epoch: Epoch, checks: Sequence[Reduced]) -> Stack:
    """Stack *checks*, with standing errors as large as in the epoch."""
    stacked = join_checks(checks, epoch.causes)
    return stacked.rescale(epoch.stack.share / stacked.share)


def _list_causes(scenarios: Sequence[tuple[Change, ...]], index: int) -> list[int]:
    return [cause for changes in scenarios if (cause := changes[index].cause) is not None]


def _write_sentence(advised: AdvisedPoses, causes: Sequence[str]) -> str:
    first, *rivals = causes
    seats = " and ".join(f"({x:.0f}, {y:.0f}, {z:.0f}) mm" for x, y, z in advised.seats_mm)
    now, usual, this = (
        format_plain(100.0 * max(chance, 1e-3))
        for chance in (advised.now, advised.after_usual, advised.after_this)
    )
    return (
        f"to tell {first} from {' and '.join(rivals)}: seats at about {seats}, touched in turn in "
        f"these {advised.states.n} poses (chance that the likeliest cause is wrong: {now} % now, "
        f"{this} % then, {usual} % after the usual check)"
    )

"""Checks watched one after another: the alarm's statistic, and which checks are doubted."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.special import logsumexp
from test_bad_check import touched
from test_interim_changes import off_from
from test_interim_evidence import a_stack

from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.bad_check import ONE_IN, OtherChecks, find_spoilt
from armd.compensation.interim.evidence.likelihood import LIMIT, compute_log_marginal, run, weigh
from armd.compensation.interim.evidence.stack import RunningSums, Stack
from armd.compensation.interim.evidence.watch import UNSETTLED, detect_changes


@pytest.mark.parametrize("seed", range(3))
def test_where_no_check_is_doubted_the_statistic_is_the_alarms(seed: int) -> None:
    of, causes = off_from(np.random.default_rng(seed), 99, 99)  # never off
    watched = detect_changes(of, causes)
    assert watched.bad == ()
    expected = run(RunningSums(of), causes)
    until = of.n if watched.alarm is None else watched.alarm + 1
    assert watched.statistic[:until] == pytest.approx(expected[:until], abs=1e-9)
    assert np.isnan(watched.statistic[until:]).all()


def test_the_alarm_is_the_first_check_over_the_limit() -> None:
    of, causes = off_from(np.random.default_rng(1), 12, 40)
    watched = detect_changes(of, causes)
    expected = run(RunningSums(of), causes)
    assert watched.alarm == int(np.argmax(expected >= LIMIT)) > 12
    later = detect_changes(of, causes, since=20)  # what was before is no onset any more
    assert np.isnan(later.statistic[:20]).all()
    assert later.statistic[20] < watched.statistic[watched.alarm]


def test_a_check_known_to_be_bad_has_no_part() -> None:
    of, causes = off_from(np.random.default_rng(2), 99, 99)
    spoilt_one = 5
    kept = [i for i in range(of.n) if i != spoilt_one]
    watched = detect_changes(of, causes, since=8, known_bad=[spoilt_one])
    expected = run(RunningSums(of.select_checks(kept)), causes, since=7)
    until = len(expected) if watched.alarm is None else watched.alarm - 7
    assert watched.statistic[8 : 8 + until] == pytest.approx(expected[:until], abs=1e-9)
    assert watched.bad == (spoilt_one,)


def by_hand(of: Stack, causes: list[Cause], doubted: list[int]) -> float:
    """Log odds of a change, over all ways in which the *doubted* checks may be bad."""

    def marginal(checks: list[int]) -> float:
        return compute_log_marginal(of, of.sum_checks(checks))

    clean = [i for i in range(of.n) if i not in doubted]
    nothing, change = [], []
    for k in range(len(doubted) + 1):
        for way in combinations(doubted, k):
            kept = [i for i in range(of.n) if i not in way]
            weight = marginal(kept)
            for i in way:  # how likely its numbers are as a spoilt check's, given the clean ones
                with_it = sorted([*clean, i])
                weight += (
                    marginal(with_it)
                    - marginal(clean)
                    + OtherChecks(of, of.sum_checks(with_it)).log_evidence(i)
                )
                weight -= np.log(ONE_IN)
            onsets = np.arange(len(kept))
            ratio = weigh(RunningSums(of.select_checks(kept)), causes, len(kept), onsets).log_sum
            nothing.append(weight)
            change.append(weight + ratio)
    return float(logsumexp(change) - logsumexp(nothing))


def test_a_doubted_check_is_weighed_both_ways() -> None:
    _, causes = a_stack(np.random.default_rng(0))
    of = touched(0)
    residual = [*of.residual[:-1], of.residual[-1] + of.targets[-1][:, :3] @ [0.05, 0.02, -0.03]]
    off = Stack(of.time_d, tuple(residual), of.columns, of.error_columns, of.targets, of.blocks)
    doubted = list(find_spoilt(off, off.sum_checks(range(off.n)), range(off.n - UNSETTLED, off.n)))
    assert doubted == [off.n - 1]
    watched = detect_changes(off, causes)
    assert watched.statistic[-1] == pytest.approx(by_hand(off, causes, doubted), abs=1e-9)
    assert watched.bad == (off.n - 1,) and not watched.strange
    # Taken for good, it would have been a change.
    assert run(RunningSums(off), causes)[-1] > watched.statistic[-1]


def test_three_in_a_row_that_nothing_explains_are_a_change_without_a_name() -> None:
    rng = np.random.default_rng(3)
    of, causes = off_from(rng, 99, 99)
    far = [rng.normal(size=3) for _ in range(UNSETTLED)]
    residual = list(of.residual)
    for i, shift in zip(range(20, 20 + UNSETTLED), far, strict=True):
        residual[i] = residual[i] + 3.0 * of.targets[i] @ shift
    off = Stack(of.time_d, tuple(residual), of.columns, of.error_columns, of.targets, of.blocks)
    watched = detect_changes(off, causes)
    assert watched.alarm == 20 + UNSETTLED - 1
    assert watched.strange and watched.bad == ()

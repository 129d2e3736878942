"""When a change was, of weights and checks made up by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_interim_evidence import a_stack

from armd.compensation.interim.changes.change import Change
from armd.compensation.interim.changes.dates import find_instant, find_interval
from armd.compensation.interim.changes.likeliest import LEAST_SHARE, find_likeliest
from armd.compensation.interim.changes.onset_interval import COVERAGE, find_onset_interval
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.likelihood import SIZES, Weighed
from armd.compensation.interim.evidence.stack import Stack

DAY_S = 86400.0


@pytest.mark.parametrize(
    ("share", "run"),
    [
        ([0.03, 0.50, 0.46, 0.01], (1, 2)),
        ([0.5, 0.04, 0.46], (0, 2)),  # what lies between belongs to it
        ([0.01, 0.04, 0.90, 0.05], (2, 3)),  # of two as short, the heavier
        ([1.0], (0, 0)),
    ],
)
def test_the_interval_is_the_shortest_that_holds_enough(share, run) -> None:
    assert find_onset_interval(np.array(share)) == run
    assert find_onset_interval(7.0 * np.array(share)) == run  # weights need no sum


def test_no_shorter_run_of_random_weights_holds_enough() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        share = rng.dirichlet(np.full(9, 0.3))
        a, b = find_onset_interval(share)
        assert share[a : b + 1].sum() >= COVERAGE - 1e-12
        shorter = [share[i : i + b - a].sum() for i in range(9 - (b - a) + 1)]
        assert max(shorter) < COVERAGE


def checks(n: int = 6) -> Any:
    """One a day at noon, of an hour; the first is day 0's."""
    return [
        SimpleNamespace(
            mean_unix_s=DAY_S * i, first_unix_s=DAY_S * i - 1800, last_unix_s=DAY_S * i + 1800
        )
        for i in range(n)
    ]


def daily(n: int = 6) -> Any:
    return SimpleNamespace(gap_d=1.0, n=n)


def a_change(first: int, earliest: int, latest: int, **more: Any) -> Change:
    return Change(0, more.pop("gradual", False), first, earliest, latest, more.pop("at", 0.0), 1.0)


@pytest.mark.parametrize(
    ("change", "bad", "since", "until", "instant"),
    [
        # A sudden one was between the last good check and the first with it.
        (a_change(3, 3, 4), [], 2 * DAY_S + 1800, 4 * DAY_S - 1800, 2.5 * DAY_S),
        # A bad check cannot say whether it had the change.
        (a_change(3, 3, 3), [2], DAY_S + 1800, 3 * DAY_S - 1800, 2.0 * DAY_S),
        # One from the first check on began at most a usual gap before.
        (a_change(0, 0, 0), [], -DAY_S - 1800, -1800, -1800 - DAY_S / 2),
        # A growth began between two checks or beside them.
        (a_change(3, 3, 4, gradual=True, at=2.25), [], 1.5 * DAY_S, 4 * DAY_S - 1800, 2.25 * DAY_S),
    ],
)
def test_when_a_change_was(
    change: Change, bad: list[int], since: float, until: float, instant: float
) -> None:
    assert find_interval(checks(), daily(), change, bad) == (since, until)
    assert find_instant(checks(), daily(), change, bad) == instant


def test_a_change_that_no_good_check_was_before_began_a_usual_gap_before_the_first() -> None:
    assert find_interval(checks(), daily(), a_change(2, 2, 2), [0, 1])[0] == DAY_S - 1800
    assert find_interval(checks(), daily(), a_change(1, 1, 1, gradual=True), [])[0] == -DAY_S - 1800


def weighed(share: np.ndarray) -> Weighed:
    """Of weights (T, K, 2), as much of each size."""
    by_size = np.repeat(share[..., None] / len(SIZES), len(SIZES), axis=3)
    with np.errstate(divide="ignore"):
        return Weighed(np.arange(len(share)), np.log(by_size))


def three_forms() -> tuple[Stack, list[Cause]]:
    """Two forms of one cause at one place, and another cause."""
    of, (one, two) = a_stack(np.random.default_rng(0))
    return of, [one, two, Cause(one.candidate, 0.1, 0.1)]


def test_a_place_is_all_its_forms_and_onsets_together() -> None:
    of, causes = three_forms()
    share = np.zeros((of.n, 3, 2))
    share[1, 1, 0] = 0.40  # the largest single one
    share[2, 0, 0], share[3, 0, 0], share[2, 2, 0] = 0.28, 0.02, 0.30
    change = find_likeliest(of, causes, weighed(share), list(range(of.n)))
    assert change.cause == 2 and not change.gradual and change.first == 2
    assert change.probability == pytest.approx(0.60)
    assert change.gradual_probability == 0.0
    ((rival, probability),) = change.rivals
    assert rival == 1 and probability == pytest.approx(0.40)
    # Onsets are those of all causes: 0.40, 0.58 and 0.02.
    assert (change.earliest, change.latest) == (1, 2)


def test_checks_left_out_do_not_count_among_the_onsets() -> None:
    of, causes = three_forms()
    share = np.zeros((of.n - 1, 3, 2))
    share[2, 1, 0] = 1.0 - LEAST_SHARE / 2
    share[2, 0, 0] = LEAST_SHARE / 2  # not worth a line
    change = find_likeliest(of.select_checks([0, 1, 2, 3, 4]), causes, weighed(share), [0, 2, 3, 4])
    assert change.first == change.earliest == change.latest == 3
    assert change.rivals == ()


def test_a_growth_is_one_where_most_of_its_weight_grows() -> None:
    of, causes = three_forms()
    share = np.zeros((of.n, 3, 2))
    share[2, 1, 0], share[2, 1, 1] = 0.4, 0.6
    change = find_likeliest(of, causes, weighed(share), list(range(of.n)))
    assert change.gradual and change.cause == 1
    assert change.gradual_probability == pytest.approx(0.6)
    assert change.origin_d == of.time_d[change.first - 1]

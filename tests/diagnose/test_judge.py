"""Two models held against each other by squared residuals that are given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.constants import CHANGED_PRIOR, MOST_SQUARES, MOST_WORSE
from armd.compensation.diagnose.heldout.judge import HoldoutScheme, Judge
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, tie
from armd.compensation.model.slow_factors import Time
from support.small_fit import candidate

N = 200
GROUPS = np.repeat(np.arange(40), 5)
#: Squared residuals (mm²) that readings have in common.
PATTERN = 1e-4 * (1.0 + 0.2 * np.random.default_rng(4).random(N))
SLOW = Candidate(
    "geometry_drift", location.joint(2),
    (Column("a", "mm", 1.0, tie([("a_2", 1.0)], Time(since_unix_s=0.0))),), ("time_s",),
)  # fmt: skip
NOTHING, ONE, GROWN = ((), False), ((0,), False), ((0,), True)


def judge(
    *schemes: dict[Any, np.ndarray | float],
    findings: Sequence[Candidate] = (),
    uninformative: bool = False,
    later: dict[Any, float] | None = None,
) -> Judge:
    """Each scheme by its squared residuals of a model, as multiples of `PATTERN` or row by row."""

    def squares_of(table: dict[Any, Any]) -> Any:
        return lambda some, growth: PATTERN * table[(tuple(some), growth)]

    last: Any = SimpleNamespace(findings=tuple(findings) or (candidate("encoder_scale", 1),))
    return Judge(
        last,
        [HoldoutScheme(squares_of(table), GROUPS) for table in schemes],
        lambda _finding, _some: uninformative,
        None if later is None else squares_of(later),
    )


def test_what_predicts_better_is_shown_with_its_figures() -> None:
    shown = judge({NOTHING: 4.0, ONE: 1.0}).find_confirming_scheme(NOTHING, ONE)
    assert shown is not None and shown[0] == 0
    assert shown[1].before_um == pytest.approx(2.0 * shown[1].after_um)
    assert shown[1].after_um == pytest.approx(1e3 * math.sqrt(PATTERN.mean()))
    assert judge({NOTHING: 1.0, ONE: 1.0}).find_confirming_scheme(NOTHING, ONE) is None
    assert judge({NOTHING: 1.0, ONE: 1.1}).find_confirming_scheme(NOTHING, ONE) is None


def test_a_further_scheme_speaks_only_where_the_first_is_not_against_it() -> None:
    same, worse, better = {NOTHING: 1.0, ONE: 1.0}, {NOTHING: 1.0, ONE: 1.5}, {NOTHING: 4.0, ONE: 1}
    shown = judge(same, better).find_confirming_scheme(NOTHING, ONE)
    assert shown is not None and shown[0] == 1
    assert judge(worse, better).find_confirming_scheme(NOTHING, ONE) is None
    confirmed = judge(worse, better, uninformative=True).find_confirming_scheme(NOTHING, ONE)
    assert confirmed is not None and confirmed[0] == 1


def test_gross_readings_do_not_decide_but_may_not_be_harmed() -> None:
    gross = np.ones(N)
    gross[:4] = 1e4
    before = 4.0 * np.ones(N)
    before[:4] = 1e4
    # All the others halve; the gross ones stay.
    assert judge({NOTHING: before, ONE: gross}).find_confirming_scheme(NOTHING, ONE) is not None
    gross[:4] *= (1.0 + 2.0 * MOST_WORSE) ** 2
    assert judge({NOTHING: before, ONE: gross}).find_confirming_scheme(NOTHING, ONE) is None


def test_a_drift_must_foretell_what_came_after() -> None:
    worse, better = {NOTHING: 1.0, ONE: 1.01}, {NOTHING: 1.0, ONE: 0.99}
    assert not judge({}, findings=[SLOW], later=worse).predicts_later_no_worse(NOTHING, ONE)
    assert judge({}, findings=[SLOW], later=better).predicts_later_no_worse(NOTHING, ONE)
    assert judge({}, later=worse).predicts_later_no_worse(NOTHING, ONE)  # what is no drift need not
    assert judge({}, findings=[SLOW]).predicts_later_no_worse(NOTHING, ONE)  # nothing came after
    assert judge({}, findings=[SLOW], later=worse).predicts_later_no_worse(
        ONE, GROWN
    )  # it was there before


def test_harm_is_a_larger_sum_without_gross_readings() -> None:
    assert judge({NOTHING: 1.0, ONE: 1.01}).is_harmful(0, NOTHING, ONE)
    assert not judge({NOTHING: 1.0, ONE: 0.99}).is_harmful(0, NOTHING, ONE)
    assert not judge({NOTHING: 1.0, ONE: 1.01}, uninformative=True).is_harmful(0, NOTHING, ONE)
    one_far = np.ones(N)
    one_far[7] = 1e6  # counts as so many usual ones at most: the others outvote it
    others = np.full(N, 1.0 - 2.0 * MOST_SQUARES / N)
    others[7] = 2e6
    assert not judge({NOTHING: one_far, ONE: others}).is_harmful(0, NOTHING, ONE)


def test_doubt_is_a_likelihood_ratio_down_to_that_the_arm_changed() -> None:
    """Normal errors of three directions: the log of the ratio is half the sum over the variance."""
    assert judge({NOTHING: 1.0, ONE: 1.0}).compute_odds_factor(0, NOTHING, ONE) == 1.0
    assert judge({NOTHING: 1.0, ONE: 0.5}).compute_odds_factor(0, NOTHING, ONE) == 1.0
    share = 1.0 / 300.0  # worse by so much everywhere: beyond doubt, and a nat in all
    found = judge({NOTHING: 1.0, ONE: 1.0 + share}).compute_odds_factor(0, NOTHING, ONE)
    assert found == pytest.approx(math.exp(-0.5 * 3.0 * N * share))
    assert judge({NOTHING: 1.0, ONE: 1.5}).compute_odds_factor(0, NOTHING, ONE) == CHANGED_PRIOR
    assert (
        judge({NOTHING: 1.0, ONE: 1.5}, uninformative=True).compute_odds_factor(0, NOTHING, ONE)
        == 1.0
    )


def test_growth_is_judged_by_the_last_scheme() -> None:
    first = {ONE: 1.0, GROWN: 5.0}
    assert judge(first, {ONE: 1.0, GROWN: 0.99}).predicts_better_with_growth((0,))
    assert not judge(first, {ONE: 1.0, GROWN: 1.01}).predicts_better_with_growth((0,))


def test_a_model_is_worked_out_once() -> None:
    asked = []

    def squares(some: Sequence[int], growth: bool) -> np.ndarray:
        asked.append((tuple(some), growth))
        return PATTERN

    nothing: Any = SimpleNamespace(findings=())
    one = Judge(nothing, [HoldoutScheme(squares, GROUPS)], lambda *_: False, None)
    one.errors(NOTHING), one.errors(NOTHING), one.errors(ONE)
    assert asked == [NOTHING, ONE]

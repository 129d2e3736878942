"""From alarms to changes: one that later checks refute is withdrawn, one that stays is kept."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logsumexp

from armd.compensation.effects.effect import Candidate, Column
from armd.compensation.effects.location import joint
from armd.compensation.interim.changes.change import Change, add_known_changes
from armd.compensation.interim.changes.find import find
from armd.compensation.interim.changes.growing import Growing
from armd.compensation.interim.changes.growth import Growths
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.likelihood import (
    compute_log_marginal,
    estimate_known_errors,
)
from armd.compensation.interim.evidence.stack import Stack
from support.selection import parametrize_default

CHECKS, ROWS, FIRST = 40, 8, 8


def off_from(rng: np.random.Generator, first: int, until: int) -> tuple[Stack, list[Cause]]:
    """Checks of two causes; those from *first* to *until* are off by the first one's column, each
    by about one and a half standard deviations of what it alone can tell."""
    columns = tuple(rng.normal(size=(ROWS, 2)) / np.sqrt(ROWS) for _ in range(CHECKS))
    residual = tuple(
        rng.normal(size=ROWS) + (1.5 * c[:, 0] if first <= i < until else 0.0)
        for i, c in enumerate(columns)
    )
    targets = tuple(20.0 * rng.normal(size=(ROWS, 3)) for _ in range(CHECKS))
    known = tuple(0.1 * rng.normal(size=(ROWS, 1)) for _ in range(CHECKS))
    causes = [
        Cause(Candidate("geometry_shift", joint(k), (Column("a", "mm", 1.0),), ()), 0.5, 0.0)
        for k in (2, 3)
    ]
    days = np.arange(CHECKS, dtype=float)
    return Stack(days, residual, columns, known, targets, (slice(0, 1), slice(1, 2))), causes


@parametrize_default("seed", range(4))
def test_an_alarm_that_later_checks_refute_is_withdrawn(seed: int) -> None:
    staying, causes = off_from(np.random.default_rng(seed), FIRST, CHECKS)
    (change,) = find(staying, causes).changes
    assert change.cause == 0 and change.earliest <= FIRST <= change.latest
    alarm = find(staying, causes).alarm
    assert alarm is not None
    # Off until it is told, and never again.
    passing, _ = off_from(np.random.default_rng(seed), FIRST, alarm + 1)
    assert len(find(passing.select_checks(range(alarm + 1)), causes).changes) == 1
    later = find(passing, causes)
    assert later.alarm == alarm  # it was told, and the statistic says so
    # Another one by chance, later on, is within the rate that is stated.
    assert all(change.first > alarm for change in later.changes)


def a_month(rng: np.random.Generator) -> Stack:
    """Checks of unlike sizes, some days apart, of a cause of one column and one of three."""
    rows = rng.integers(3, 7, size=30)
    return Stack(
        np.cumsum(rng.uniform(0.3, 4.0, len(rows))),
        tuple(rng.normal(size=r) for r in rows),
        tuple(5.0 * rng.normal(size=(r, 4)) for r in rows),
        tuple(rng.normal(size=(r, 2)) for r in rows),
        tuple(np.zeros((r, 0)) for r in rows),
        (slice(0, 1), slice(1, 4)),
    )


def plainly(of: Stack, course: Change) -> float:
    """Log of how likely all readings are with a course, by a stack that knows it."""
    knowing = add_known_changes(of, [course])
    return compute_log_marginal(knowing, knowing.sum_checks(range(of.n)))


@pytest.mark.parametrize("cause", [0, 1])
def test_growths_from_many_onsets_are_as_likely_as_of_a_stack_that_knows_each(cause: int) -> None:
    rng = np.random.default_rng(3)
    of = a_month(rng)
    size = rng.uniform(0.1, 3.0, of.blocks[cause].stop - of.blocks[cause].start)
    end = float(of.time_d[-1])
    # Onsets at checks, between them, and before all; bends between checks, at one, and at the last.
    origins = [-3.0, 0.1, *of.time_d[:12:3].tolist()]
    courses = [
        Change(cause, True, 0, 0, 0, at, 1.0, bends_d=bends, rate_size=size)
        for bends in ((), (float(of.time_d[12]), end - 5.0, end), (float(of.time_d[20]) + 0.01,))
        for at in origins
    ]
    expected = np.array([plainly(of, course) for course in courses])
    assert np.ptp(expected) > 1.0
    found = Growing(of).log_marginals(cause, courses)
    assert found == pytest.approx(expected, rel=1e-11)
    # Their ratios are what counts; they lose the sum's own rounding alone.
    assert np.exp(found - found.max()) == pytest.approx(
        np.exp(expected - expected.max()), rel=1e-9, abs=0.0
    )


@pytest.mark.parametrize("cause", [0, 1])
def test_shares_of_onsets_and_rates_are_those_of_the_plain_formulas(cause: int) -> None:
    of = a_month(np.random.default_rng(4))
    kept = [i for i in range(of.n) if i not in (0, 9, 10)]
    some = of.select_checks(kept)
    change = Change(cause, True, 3, 3, 3, float(of.time_d[2]), 1.0, size=3.0)
    found = Growths(of, kept).weigh_onsets(change, kept)
    courses = [course for _, course in found]
    assert [course.first for course in courses] == kept
    # A bend at every third check until the last but one, none before a growth's first check.
    bends = some.time_d[[1, 4, 7, 10, 13, 16, 19, 22, 25]]
    assert all(c.bends_d == tuple(bends[bends > of.time_d[c.first]]) for c in courses)
    q = of.error_columns[0].shape[1]
    alone = add_known_changes(some, [change])
    rate = np.abs(change.size * estimate_known_errors(alone.sum_checks(range(some.n))).mean[q:])
    for course in courses:
        assert course.rate_size == pytest.approx(np.maximum(rate, 0.1 * rate.max()), rel=1e-9)
    by_hand = np.array([plainly(some, course) for course in courses])
    assert [share for share, _ in found] == pytest.approx(
        np.exp(by_hand - logsumexp(by_hand)), rel=1e-9, abs=0.0
    )

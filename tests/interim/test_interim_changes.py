"""From alarms to changes: one that later checks refute is withdrawn, one that stays is kept."""

from __future__ import annotations

import numpy as np
import pytest
from test_interim_evidence import a_stack

from armd.compensation.effects.effect import Candidate, Column
from armd.compensation.effects.location import joint
from armd.compensation.interim.changes.change import Change, with_changes
from armd.compensation.interim.changes.find import find
from armd.compensation.interim.changes.growth import log_marginals
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.likelihood import log_marginal
from armd.compensation.interim.evidence.stack import Stack

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


@pytest.mark.parametrize("seed", range(4))
def test_an_alarm_that_later_checks_refute_is_withdrawn(seed: int) -> None:
    staying, causes = off_from(np.random.default_rng(seed), FIRST, CHECKS)
    (change,) = find(staying, causes).changes
    assert change.cause == 0 and change.earliest <= FIRST <= change.latest
    alarm = find(staying, causes).alarm
    assert alarm is not None
    # Off until it is told, and never again.
    passing, _ = off_from(np.random.default_rng(seed), FIRST, alarm + 1)
    assert len(find(passing.only(range(alarm + 1)), causes).changes) == 1
    later = find(passing, causes)
    assert later.alarm == alarm  # it was told, and the statistic says so
    # Another one by chance, later on, is within the rate that is stated.
    assert all(change.first > alarm for change in later.changes)


@pytest.mark.parametrize("cause", [0, 1])
def test_a_growths_likelihood_is_that_of_a_stack_that_knows_it(cause: int) -> None:
    rng = np.random.default_rng(3)
    of, _ = a_stack(rng)
    p = of.blocks[cause].stop - of.blocks[cause].start
    courses = [
        Change(cause, True, first, first, first, at, 1.0, bends_d=bends,
               rate_size=rng.uniform(0.1, 3.0, p))
        for first, at, bends in ((1, 0.2, ()), (2, 1.1, (2.5, 4.0)), (4, 3.0, (5.5,)))
    ]  # fmt: skip
    knowing = [with_changes(of, [course]) for course in courses]
    expected = [log_marginal(one, one.sums(range(one.n))) for one in knowing]
    assert log_marginals(of, cause, courses) == pytest.approx(expected, abs=1e-9)

"""A growth over hundreds of checks bends as use does: neither is what it does between two bends
another change, nor does it hide one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp

from armd.arrays import F64
from armd.compensation.effects.effect import Candidate, Column
from armd.compensation.effects.location import joint
from armd.compensation.interim.changes.change import (
    BENDING,
    Change,
    add_known_changes,
    compute_shapes,
    list_amplitude_sizes,
)
from armd.compensation.interim.changes.growth import (
    CHECKS_APART,
    LONG_BENDINGS,
    Growths,
    fit_growth,
)
from armd.compensation.interim.changes.likeliest import find_likeliest, weigh_since
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.likelihood import LIMIT, MOST_BACK, Weighed
from armd.compensation.interim.evidence.stack import Stack

CHECKS, ROWS, FIRST, SLIP, SIZE = 300, 8, 40, 200, 8.0


def used(rng: np.random.Generator) -> F64:
    """(CHECKS,) of a wear, 0 … 1: five days a week are worked, more in some months than in
    others."""
    month = np.repeat(np.exp(rng.normal(0.0, 0.4, CHECKS // 20)), 20)
    hours = month * np.exp(rng.normal(0.0, 0.4, CHECKS)) * (np.arange(CHECKS) % 7 < 5)
    hours[:FIRST] = 0.0
    share: F64 = np.cumsum(hours) / hours.sum()
    return share


def worn(seed: int, slip: float = 0.0) -> tuple[Stack, list[Cause]]:
    """One thing wears from the check `FIRST` on to `SIZE` typical sizes, and may slip by itself;
    another does nothing."""
    rng = np.random.default_rng(seed)
    columns = tuple(4.0 * rng.normal(size=(ROWS, 2)) for _ in range(CHECKS))
    course = SIZE * used(rng) + slip * (np.arange(CHECKS) >= SLIP)
    residual = tuple(
        rng.normal(size=ROWS) + at * own[:, 0] for at, own in zip(course, columns, strict=True)
    )
    known = tuple(0.1 * rng.normal(size=(ROWS, 1)) for _ in range(CHECKS))
    causes = [
        Cause(Candidate("geometry_shift", joint(k), (Column("a", "mm", 1.0),), ()), 0.25, 0.25)
        for k in (2, 3)
    ]
    # What slips is what wears, under another name.
    causes.append(Cause(Candidate("encoder_slip", joint(2), (Column("a", "mm", 1.0),), ()), 0.5, 0))
    columns = tuple(own[:, [0, 1, 0]] for own in columns)
    blocks = tuple(slice(k, k + 1) for k in range(3))
    targets = tuple(20.0 * rng.normal(size=(ROWS, 3)) for _ in range(CHECKS))
    return Stack(np.arange(float(CHECKS)), residual, columns, known, targets, blocks), causes


def beside(of: Stack, causes: Sequence[Cause]) -> tuple[Change, Weighed, Change]:
    """The growth, and how likely another change is beside it, and which."""
    kept = [*range(of.n)]
    begun = Change(0, True, FIRST, FIRST, FIRST, FIRST - 1.0, 1.0)
    grows = fit_growth(of, begun, kept, kept[FIRST - 20 : FIRST + 20])
    knowing = add_known_changes(of, [grows])
    weighed, _ = weigh_since(knowing, causes, grows.first + 1, of.n, of.n, ())
    return grows, weighed, find_likeliest(knowing, causes, weighed, kept)


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_what_use_does_between_two_bends_is_no_second_change(seed: int) -> None:
    grows, another, _ = beside(*worn(seed))
    assert grows.earliest <= FIRST <= grows.latest
    assert another.log_alarm < LIMIT


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_slip_of_what_wears_is_told(seed: int) -> None:
    _, another, which = beside(*worn(seed, slip=0.5))
    assert another.log_alarm > LIMIT
    assert (which.cause, which.gradual) == (2, False) and abs(which.first - SLIP) <= 1


def test_how_many_bends_a_course_has_changes_nothing_of_what_is_likely() -> None:
    of, _ = worn(0)
    kept = [*range(CHECKS)]
    change = Change(0, True, FIRST, FIRST, FIRST, FIRST - 1.0, 1.0)
    ((_, found),) = Growths(of, kept).weigh_onsets(change, [FIRST])
    assert found.rate_size is not None

    def deviation(course: Change) -> F64:
        """Of where it is beforehand, but for its first rate."""
        sizes = list_amplitude_sizes(course, 1)[1:, 0]
        return np.sqrt(((compute_shapes(of, course)[:, 1:] * sizes) ** 2).sum(axis=1))

    bends = tuple(of.time_d[range(CHECKS - 2, FIRST, -CHECKS_APART)][::-1].tolist())
    fine_one = replace(found, bends_d=bends, bending=BENDING)
    half = fine_one.coarser
    assert half.bends_d == bends[::-1][::2][::-1]
    assert half.coarser.bends_d == bends[::-1][::4][::-1]
    assert deviation(half)[-1] == pytest.approx(deviation(fine_one)[-1], rel=0.03)
    assert deviation(half.coarser)[-1] == pytest.approx(deviation(fine_one)[-1], rel=0.06)
    # So it is with the course that was chosen, whose bends lie as far apart as they may.
    per_check = found.bending**2 / np.diff(found.bends_d)
    shares = [one**2 / CHECKS_APART for one in LONG_BENDINGS]
    assert np.ptp(per_check) == pytest.approx(0.0, abs=1e-12)
    assert min(abs(per_check[0] / share - 1) for share in shares) < 1e-9


def test_the_alarm_is_of_as_many_onsets_as_its_limit() -> None:
    first = np.arange(3 * MOST_BACK)
    flat = np.zeros((len(first), 2, 2, 1))
    assert Weighed(first, flat).log_alarm == pytest.approx(np.log(4 * MOST_BACK))
    assert Weighed(first, flat).log_sum == pytest.approx(np.log(12 * MOST_BACK))
    few = Weighed(first[:5], np.random.default_rng(1).normal(size=(5, 2, 2, 3)))
    assert few.log_alarm == pytest.approx(few.log_sum)
    # One that lies anywhere is found whole.
    for at in (0, 200, len(first) - 1):
        high = flat.copy()
        high[at] = 9.0
        rest = np.log(4 * (MOST_BACK - 1))
        assert Weighed(first, high).log_alarm == pytest.approx(
            logsumexp([9.0 + np.log(4), rest]), rel=1e-12
        )

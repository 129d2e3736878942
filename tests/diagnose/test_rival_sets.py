"""How sure a finding is beside sets that lack it: odds worked out by hand; t by scipy."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm, ttest_1samp

from armd.compensation.diagnose.diagnosis import Finding, Rival, RivalCauses
from armd.compensation.diagnose.heldout.fold_residuals import count_standard_errors
from armd.compensation.diagnose.scoring.confusion import Likeness
from armd.compensation.diagnose.scoring.shape import locate_shape
from armd.compensation.diagnose.search import rival_sets
from armd.compensation.diagnose.search.refusals import Refusals
from armd.compensation.effects.effect import Candidate
from support.small_fit import candidate, small_fit

N = 12
WOBBLE, LENGTH = candidate("axis_wobble", 2), candidate("link_expansion", 2)
GEARS, SENSOR = candidate("gear_mesh", 1), candidate("sensor_offset", 2)


def told(monkeypatch: pytest.MonkeyPatch, *rivals: tuple[list[Candidate], float]) -> list[Finding]:
    """A wobble (P = 0.9, a slip is its rival) and a length's expansion beside sets."""
    monkeypatch.setattr(
        rival_sets, "compute_likeness", lambda _, others, *__: [Likeness(7.0, 0.5) for _ in others]
    )
    some = np.ones((3 * N, 1))
    last = small_fit(np.zeros(3 * N), some, {WOBBLE: some, LENGTH: some})
    slip = Rival(candidate("encoder_slip", 2), 0.1, 3.0)
    found = [
        Finding(WOBBLE, 1e-9, 50.0, 0.9, (slip,), ()),
        Finding(LENGTH, 1e-9, 50.0, 1.0, (), ()),
    ]
    arm: Any = None
    weighed = rival_sets.weigh_rival_sets(last.findings, rivals)
    return list(rival_sets.limit_by_rival_sets(found, last, weighed, arm))


def test_a_set_that_predicts_nearly_as_well_takes_its_chance(monkeypatch) -> None:
    wobble, length = told(monkeypatch, ([LENGTH, GEARS, SENSOR], -0.6))
    chance = norm.cdf(-0.6)
    assert wobble.probability == pytest.approx(0.9 * (1.0 - chance))
    beside = {rival.candidate: rival.probability for rival in wobble.rivals}
    assert beside[GEARS] == beside[SENSOR] == pytest.approx(0.9 * chance)
    assert sum(beside.values()) - beside[SENSOR] + wobble.probability == pytest.approx(1.0)
    assert length.probability == 1.0  # which that set has too
    assert not length.rivals


def test_sets_of_the_same_causes_count_once_and_take_the_shape_with_the_cause() -> None:
    slow, fast = (replace(GEARS, setting=(("time_constant_s", s),)) for s in (60.0, 600.0))
    shape = replace(candidate("unknown", 2), location=locate_shape(WOBBLE))
    weighed = rival_sets.weigh_rival_sets(
        [WOBBLE, LENGTH, shape],
        [([LENGTH, slow, SENSOR], -1.0), ([LENGTH, SENSOR, fast], -0.6), ([LENGTH], 1.0)],
    )
    odds = norm.cdf(-0.6) / norm.sf(-0.6)
    assert weighed == (RivalCauses((SENSOR, fast), (0, 2), pytest.approx(odds)),)


def test_rivals_of_findings_that_are_gone_are_dropped() -> None:
    rivals = [RivalCauses((GEARS,), (0, 2), 0.5), RivalCauses((SENSOR,), (1,), 0.5)]
    assert rival_sets.number_rivals(rivals, [0, 2], 3) == (
        replace(rivals[0], finding_numbers=(3, 4)),
    )


def test_a_set_that_did_not_replace_it_is_at_most_as_probable(monkeypatch) -> None:
    wobble, _ = told(monkeypatch, ([LENGTH, GEARS], 2.9))
    assert wobble.probability == pytest.approx(0.45)
    assert max(r.probability for r in wobble.rivals) <= wobble.probability
    wobble, _ = told(monkeypatch, ([LENGTH, GEARS], 2.9), ([LENGTH, SENSOR], 0.0))
    assert wobble.probability == pytest.approx(0.3)


def test_a_set_that_only_lacks_it_or_predicts_far_worse_is_no_rival(monkeypatch) -> None:
    """That something is there the significance says; what it is, only another name can dispute."""
    for set_without in ([[LENGTH], 5.0], [[LENGTH, GEARS], -3.0]):
        wobble, _ = told(monkeypatch, tuple(set_without))
        assert wobble.probability == 0.9
        assert len(wobble.rivals) == 1


def test_standard_errors_are_those_of_the_t_test_over_groups() -> None:
    rng = np.random.default_rng(68)
    before, after = rng.chisquare(3, 60), rng.chisquare(2, 60)
    groups = np.repeat(np.arange(20), 3)
    sums = (before - after).reshape(20, 3).sum(axis=1)
    expected = ttest_1samp(sums, 0.0).statistic
    assert count_standard_errors(before, after, groups) == pytest.approx(expected)
    assert count_standard_errors(before, before, groups) == 0.0


def test_what_was_refused_is_not_looked_for_at_its_place() -> None:
    refusals = Refusals([WOBBLE, GEARS])
    refusals.add(GEARS, "it would move d_2 by 12 mm")
    assert refusals.candidates == [WOBBLE] and refusals.places == {GEARS.place}
    remaining = refusals.candidates
    refusals.add(GEARS, "it would move d_2 by 12 mm")
    assert refusals.candidates is remaining, "a new list would be compiled and counted anew"
    assert [r.candidate for r in refusals.refused] == [GEARS, GEARS]

"""How probable whole sets of causes are: products and odds worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from armd.compensation.diagnose.diagnosis import Finding, Rival, RivalCauses
from armd.compensation.diagnose.report.sets import CauseSet, list_sets, select_as_probable
from support.small_fit import candidate

WOBBLE, LENGTH = candidate("axis_wobble", 2), candidate("link_expansion", 2)
GEARS, SENSOR, SLIP = (
    candidate("gear_mesh", 1), candidate("sensor_offset", 2), candidate("encoder_slip", 2),
)  # fmt: skip
SURE = Finding(LENGTH, 1e-9, 50.0, 1.0, (), ())
DOUBTFUL = Finding(WOBBLE, 1e-9, 50.0, 0.9, (Rival(SLIP, 0.1, 3.0),), ())


def test_names_are_independent_of_each_other() -> None:
    other = replace(SURE, probability=0.8, rivals=(Rival(SENSOR, 0.2, 9.0),))
    assert list_sets([DOUBTFUL, other], []) == [
        CauseSet((WOBBLE, LENGTH), pytest.approx(0.9 * 0.8)),
        CauseSet((WOBBLE, SENSOR), pytest.approx(0.9 * 0.2)),
        CauseSet((SLIP, LENGTH), pytest.approx(0.1 * 0.8)),
    ]
    assert list_sets([], []) == []


def test_causes_that_are_exchanged_take_their_odds_of_the_whole() -> None:
    """Of two sets with odds of 1 to 4, the second has both names instead of the wobble, whose own
    0.9 the search has divided by 1.25: the sets of both share what is left by 4 to 1."""
    rival = RivalCauses((GEARS, SENSOR), (0,), 0.25)
    sets = list_sets([replace(DOUBTFUL, probability=0.9 / 1.25), SURE], [rival])
    assert sets[0] == CauseSet((WOBBLE, LENGTH), pytest.approx(0.9 * 0.8))
    assert sets[1] == CauseSet((LENGTH, GEARS, SENSOR), pytest.approx(0.9 * 0.2))
    assert sets[2] == CauseSet((SLIP, LENGTH), pytest.approx(0.1 * 0.8))
    assert sum(one.probability for one in sets) == pytest.approx(0.98)  # 0.02: a slip and both


def test_a_set_for_both_findings_lowers_their_product_once() -> None:
    rival = RivalCauses((GEARS,), (0, 1), 1.0)
    both = [replace(SURE, probability=0.5), replace(DOUBTFUL, probability=0.5, rivals=())]
    sets = list_sets(both, [rival])
    assert [one.probability for one in sets] == [pytest.approx(0.5), pytest.approx(0.5)]
    assert sets[1].causes == (GEARS,)


def test_one_cause_more_takes_its_odds_of_the_whole() -> None:
    """Odds of 0.25 that something else is there as well, of which 0.2 are a sensor's."""
    further = RivalCauses((SENSOR,), (), 0.2)
    sets = list_sets([DOUBTFUL, SURE], [], [further], 0.25)
    assert sets[0] == CauseSet((WOBBLE, LENGTH), pytest.approx(0.9 * 0.8))
    assert sets[1] == CauseSet((WOBBLE, LENGTH, SENSOR), pytest.approx(0.9 * 0.8 * 0.2))
    assert sets[2] == CauseSet((SLIP, LENGTH), pytest.approx(0.1 * 0.8))


def test_an_alternative_of_a_set_is_told_with_its_set_only() -> None:
    rival = RivalCauses((GEARS, SENSOR), (0,), 0.25)
    merged = replace(DOUBTFUL, rivals=(Rival(GEARS, 0.2, 7.0), Rival(SENSOR, 0.2, 7.0)))
    assert len(list_sets([merged], [rival])) == 2
    unlikely = replace(DOUBTFUL, rivals=(Rival(SLIP, 0.001, 3.0),))
    assert len(list_sets([unlikely], [])) == 1


def test_what_several_causes_would_do_is_no_set_of_each() -> None:
    nameless = replace(candidate("unknown", 2), depends_on=("q2",))
    finding = Finding(nameless, 1e-9, 50.0, 1.0, (Rival(WOBBLE, 0.6, 0.0),), ())
    assert finding.is_of_several_names
    assert list_sets([finding], []) == [CauseSet((nameless,), 1.0)]


def test_sets_that_are_not_clearly_less_likely_are_pointed_out() -> None:
    near, far, nearer = (RivalCauses((GEARS, SENSOR), (0,), odds) for odds in (0.11, 0.09, 0.5))
    renamed = RivalCauses((GEARS,), (0,), 1.0)
    assert select_as_probable([near, far, nearer, renamed]) == [nearer, near]


def test_an_alternative_stays_that_only_another_findings_rival_has() -> None:
    """0.6 and 0.4 are the names of the first; a set with the second's stands for the other only."""
    first = replace(DOUBTFUL, probability=0.6, rivals=(Rival(GEARS, 0.4, 3.0),))
    second = replace(SURE, probability=0.5)
    sets = list_sets([first, second], [RivalCauses((GEARS, SENSOR), (1,), 1.0)])
    assert sets[0] == CauseSet((WOBBLE, LENGTH), pytest.approx(0.6 / 2))
    assert CauseSet((GEARS, LENGTH), pytest.approx(0.4 / 2)) in sets
    assert sum(one.probability for one in sets) == pytest.approx(0.8)  # 0.2: both exchanged

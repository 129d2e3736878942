"""What acts alike is bounded alike, whatever it is called; nothing was allowed less than before."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.effects import catalogue
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Column, SessionFacts
from armd.compensation.effects.largest import find_largest
from support.whole_scene import whole_scene

#: Until the limits were shared, a cause could be so many times its typical size.
TIMES_TYPICAL = 150.0
#: What several causes do, by the unit of its amplitudes.
SHARED = {"rad", "rad/rad", "rad/K", "rad/K^2", "rad/Nm", "1/K"}
#: The cause of some units that could be largest, to which the others were raised.
SETS_IT = {
    "rad": "encoder_eccentricity",
    "rad/K": "encoder_thermal",
    "rad/Nm": "link_bending",
}


@pytest.fixture(scope="module")
def facts() -> SessionFacts:
    return whole_scene().free


def bounded(facts: SessionFacts) -> list[tuple[str, Column]]:
    """The columns whose size is asked about: of causes that have a name and are no accidents."""
    return [
        (candidate.cause, column)
        for candidate in catalogue.list_all_candidates(facts)
        if candidate.cause != "unknown" and not CATALOGUE[candidate.cause].accident
        for column in candidate.columns
        if np.isinf(column.reach) and column.unit in SHARED
    ]


@pytest.mark.parametrize("coarse", [1.0, 40.0])
def test_one_unit_has_one_limit(facts: SessionFacts, coarse: float) -> None:
    """Of a fine arm and of one that its calibration leaves forty times as far off as that."""
    facts = replace(facts, scatter_rad=coarse * catalogue.WELL_MADE_RAD)
    causes: dict[str, set[str]] = defaultdict(set)
    for cause, column in bounded(facts):
        fine = find_largest(replace(column, coarseness=1.0))
        assert fine == find_largest(Column("", column.unit, 1.0)) < math.inf
        assert find_largest(column) == pytest.approx(coarse * fine), cause
        causes[column.unit].add(cause)
    assert set(causes) == SHARED
    assert {unit for unit, names in causes.items() if len(names) > 1} >= {*SETS_IT, "1/K"}


def test_nothing_is_allowed_less_than_before(facts: SessionFacts) -> None:
    most: dict[str, tuple[float, str]] = defaultdict(lambda: (0.0, ""))
    for cause, column in bounded(facts):
        assert find_largest(column) >= TIMES_TYPICAL * column.prior_sd * (1 - 1e-9), cause
        most[column.unit] = max(most[column.unit], (column.prior_sd, cause))
    for unit, cause in SETS_IT.items():
        prior_sd, name = most[unit]
        assert name == cause
        assert find_largest(Column("", unit, prior_sd)) == pytest.approx(TIMES_TYPICAL * prior_sd)

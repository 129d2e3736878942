"""The odds of one more cause, from evidences and priors that are added by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.constants import FURTHER_ODDS
from armd.compensation.diagnose.search.further_causes import weigh_further_causes
from support.small_fit import candidate

GEAR, LAG, SLIP = candidate("gear_mesh", 1), candidate("thermal_lag", 2), candidate("slip", 3)


def make_scores(*weighed: tuple[Any, float]) -> Any:
    """Scores of candidates with evidence × prior."""
    candidates, weights = zip(*weighed, strict=True)
    with np.errstate(divide="ignore"):
        log_weights = np.log(np.array(weights))
    total = float(np.log(sum(weights)))
    return SimpleNamespace(
        signatures=SimpleNamespace(candidates=candidates),
        log_total=total,
        log_posterior=lambda: log_weights - total,
    )


def test_values_of_one_place_are_one_cause_and_absorbed_ones_are_none() -> None:
    slower = replace(LAG, setting=(("time_constant", 900.0, "s"),))
    scores = make_scores((GEAR, 0.01), (LAG, 0.1), (slower, 0.3), (SLIP, 0.0))
    listed, odds = weigh_further_causes(scores, [])
    assert odds == pytest.approx(FURTHER_ODDS * 0.41)
    assert [(one.instead, one.finding_numbers) for one in listed] == [((slower,), ())]
    assert listed[0].odds == pytest.approx(FURTHER_ODDS * 0.4)


def test_a_finding_in_another_form_is_no_further_cause() -> None:
    expected = replace(SLIP, expected=True)  # expansion that a calibration could not know
    scores = make_scores((GEAR, 2.0), (LAG, 0.5), (expected, 3.0))
    listed, odds = weigh_further_causes(scores, [GEAR])
    assert odds == pytest.approx(FURTHER_ODDS * 0.5)
    assert [one.instead for one in listed] == [(LAG,)]

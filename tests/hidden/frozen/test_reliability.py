"""Tables of how far certainty holds, on answers written by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hidden.frozen.case import Cause, Truth
from hidden.frozen.reliability import (
    list_causes,
    list_gains,
    list_promises,
    list_sets,
    list_sizes,
    make_tables,
)
from hidden.frozen.run import Ran

ARC_SECOND = 4.84813681e-6
SCALE = Cause("encoder_scale", "joint 3", 12.0, variables=("q3",))
WAVE = Cause("encoder_periodic", "joint 1", 9.0, variables=("q1",))
TRUTH = Truth(
    "pair", 1, "encoder_scale joint 3 -6.5 + encoder_periodic joint 1 2", (SCALE, WAVE)
)  # fmt: skip


def finding(cause: Cause, probability: float, *sizes: tuple[float, float]) -> dict[str, object]:
    fitted = [
        {"name": "sin", "unit": "rad", "value": v, "standard_uncertainty": u} for v, u in sizes
    ]
    scanned = {"name": "order", "value": 4, "standard_uncertainty": 0.0}
    return {
        "cause": cause.cause, "location": cause.location, "probability": probability,
        "depends_on": list(cause.variables), "in_extended_calibration": True,
        "parameters": [*fitted, scanned], "gain": {"interval_um": [1.0, 2.0]},
    }  # fmt: skip


RAN = Ran(
    (
        finding(SCALE, 0.9, (-6.4 * ARC_SECOND, 0.06 * ARC_SECOND)),
        finding(WAVE, 0.8, (1.2 * ARC_SECOND, 0.1 * ARC_SECOND), (1.3 * ARC_SECOND, 1e-9)),
    ),
    before_um=9.0, after_um=6.6, promised_um=(9.1, 6.0),
)  # fmt: skip


def test_a_set_is_right_if_nothing_is_missing_and_nothing_is_wrong() -> None:
    assert list(list_causes(TRUTH, RAN)) == [(0.9, True), (0.8, True)]
    assert list(list_sets(TRUTH, RAN)) == [(pytest.approx(0.72), True)]
    told = replace(RAN, set_probability=0.6)
    assert list(list_sets(TRUTH, told)) == [(0.6, True)]
    half = replace(RAN, findings=RAN.findings[:1])
    assert list(list_sets(TRUTH, half)) == [(0.9, False)]  # the wave is due and missing
    elsewhere = replace(RAN, findings=(RAN.findings[0] | {"location": "joint 5"},))
    assert list(list_causes(TRUTH, elsewhere)) == [(0.9, False)]
    assert not list(list_sets(TRUTH, replace(RAN, findings=())))


def test_a_size_is_compared_in_the_units_it_was_planted_in() -> None:
    """6.4 ± 0.12 holds 6.5; of two components it is √(1.2² + 1.3²) = 1.77 ± 0.13, not 2."""
    assert list(list_sizes(TRUTH, RAN)) == [True, False]
    assert not list(list_sizes(replace(TRUTH, kind="drift"), RAN))


def test_promises_are_compared_with_later_sessions() -> None:
    assert list(list_promises(TRUTH, RAN)) == [pytest.approx(1.1)]
    assert not list(list_promises(replace(TRUTH, holdout_given=True), RAN))
    promised = replace(RAN, later_gain_um=(1.0, 2.2))
    assert list(list_gains(TRUTH, promised)) == [(False, pytest.approx(0.5))]  # 2.4 is outside
    assert [holds for holds, _ in list_gains(TRUTH, replace(promised, after_um=7.5))] == [True]
    assert not list(list_gains(TRUTH, RAN))


def test_the_tables_count_every_claim_once() -> None:
    lines = list(make_tables([(TRUTH, RAN)] * 4))
    assert sum("8 of 8, 1.000" in line for line in lines) == 1  # both causes are in one bin
    assert sum("4 of 4, 1.000" in line for line in lines) == 1
    assert any("hold what was planted: 4 of 8, 0.500" in line for line in lines)

"""A calibration of one temperature with growths: what it was there it stays, and how sure too."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.interim.checks.catalogue_digest import hash_catalogue
from armd.compensation.interim.checks.columns import list_causes
from armd.compensation.interim.checks.open_growth import OpenGrowth, list_open_growth
from armd.compensation.interim.report.growth import LinkGrowth, add_growth
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.slow_factors import Temperature
from support import synthetic

ARM = synthetic.arm()
REFERENCE_C, MADE_C = 20.0, 25.0
LENGTHS_MM = {
    name: float(value)
    for name, value in zip(ARM.layout.names, ARM.nominal(), strict=True)
    if name.startswith(("a_", "d_"))
}
CALIBRATION = Calibration(
    arm=ARM.serial_number, created="2026-03-01T00:00:00Z", reference_temperature_c=REFERENCE_C,
    temperature_range_c=dict.fromkeys(ARM.used_sensors, (MADE_C - 0.5, MADE_C + 0.5)),
    constants=LENGTHS_MM, covariance_of=["a_2"], covariance=[[4e-6]],
)  # fmt: skip


def per_kelvin(one: OpenGrowth) -> float:
    """By how much the term's basis rises while all sensors rise by one kelvin."""
    (factor,) = one.term.basis
    assert isinstance(factor, Temperature)
    return sum(factor.weights.values())


def test_lengths_stay_what_they_were_where_they_were_calibrated() -> None:
    growth = list_open_growth(ARM, CALIBRATION)
    assert len(growth) > 6
    values = np.linspace(1e-3, 9e-3, len(growth))
    seen: Any = SimpleNamespace(temperature_c={"t1": (14.0, 21.0), "t2": (20.0, 38.0)})
    grown = add_growth(CALIBRATION, growth, values, np.eye(len(growth)) * 1e-8, [seen])
    for one, value, term in zip(growth, values, grown.terms, strict=True):
        assert (term.parameter, term.coefficient) == (one.term.parameter, pytest.approx(value))
        rise_k = per_kelvin(one) * (MADE_C - REFERENCE_C)
        length_mm = grown.constants[term.parameter] + term.coefficient * rise_k
        before_mm = CALIBRATION.constants.get(term.parameter, 0.0)
        assert length_mm == pytest.approx(before_mm, abs=1e-9)
    assert grown.temperature_range_c["t1"] == (14.0, MADE_C + 0.5)
    assert grown.temperature_range_c["t2"] == (20.0, 38.0)
    assert grown.temperature_range_c["t3"] == (MADE_C - 0.5, MADE_C + 0.5)


@pytest.mark.parametrize("above_k", [0.0, 10.0])
def test_a_length_is_as_sure_there_as_it_was_and_less_elsewhere(above_k: float) -> None:
    growth = list_open_growth(ARM, CALIBRATION)
    number = next(i for i, one in enumerate(growth) if one.term.parameter == "a_2")
    size = per_kelvin(growth[number])
    spread = np.eye(len(growth)) * 1e-8
    grown = add_growth(CALIBRATION, growth, np.zeros(len(growth)), spread, [])
    row = np.zeros(len(grown.covariance_of))
    row[grown.covariance_of.index("a_2")] = 1.0
    row[grown.covariance_of.index(f"term {number}")] = size * (MADE_C + above_k - REFERENCE_C)
    variance = row @ np.array(grown.covariance) @ row
    assert variance == pytest.approx(4e-6 + 1e-8 * (size * above_k) ** 2)


@pytest.mark.parametrize(("per_k", "sure"), [(1.9e-6, False), (-2.1e-6, True)])
def test_a_growth_is_reported_whose_interval_excludes_zero(per_k: float, sure: bool) -> None:
    assert LinkGrowth("link 2", per_k, 1e-6).is_significant is sure


def test_a_digest_is_of_all_causes_and_of_the_open_growth() -> None:
    causes, growth = list_causes(ARM, CALIBRATION), list_open_growth(ARM, CALIBRATION)
    warmer = CALIBRATION.model_copy(
        update={"temperature_range_c": dict.fromkeys(ARM.used_sensors, (27.5, 28.5))}
    )
    digests = [
        hash_catalogue(causes),
        hash_catalogue(causes[1:]),
        hash_catalogue(causes, growth),
        hash_catalogue(causes, growth[1:]),
        hash_catalogue(causes, list_open_growth(ARM, warmer)),
    ]
    assert len(set(digests)) == len(digests)
    assert (
        hash_catalogue(list_causes(ARM, CALIBRATION), list_open_growth(ARM, CALIBRATION))
        == digests[2]
    )

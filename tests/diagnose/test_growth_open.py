"""A calibration made at one temperature, and sessions that are warmer or colder."""

from __future__ import annotations

import numpy as np
import pytest
from test_expansions_left_free import ARM, ECCENTRIC, ONE_C, measured

from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.fitting.expansions import EXPANSION_PER_K
from armd.compensation.diagnose.fitting.growth_open import told_of_growth, with_growth_open
from armd.compensation.diagnose.problem.baseline import from_calibration
from armd.compensation.identify.calibrate import calibrate
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.identify.thermal.terms import length_terms
from armd.compensation.model.calibration import Calibration

SEED = 2
SHOP_C = (15.0, 18.0, 23.0, 26.0)
ELSEWHERE_C = (17.0, 25.0)


@pytest.fixture(scope="module")
def kept() -> Calibration:
    """Of a room kept within a kelvin."""
    return calibrate(measured(SEED, ONE_C), ARM).calibration


def test_what_all_links_grow_is_no_cause(kept: Calibration) -> None:
    diagnosis = diagnose(measured(SEED, SHOP_C), ARM, kept)
    assert [finding.candidate.place for finding in diagnosis.found] == []
    assert any("does not know how the links grow" in text for text in diagnosis.told)


def test_a_disc_is_found_beside_it_and_the_growth_is_written(kept: Calibration) -> None:
    diagnosis = diagnose(measured(SEED, SHOP_C, ECCENTRIC), ARM, kept)
    assert [f.candidate.place for f in diagnosis.found] == [("encoder_eccentricity", "joint 3")]
    further = measured(SEED, ELSEWHERE_C, ECCENTRIC)
    before, after = (
        float(np.sqrt((evaluate(further, ARM, model).distance_um ** 2).mean()))
        for model in (kept, diagnosis.extended)
    )
    assert after < 0.2 * before


def test_where_it_was_made_its_lengths_are_as_certain_as_before(kept: Calibration) -> None:
    """And 10 K warmer by 10 × 20e-6 of each length less."""
    plain = from_calibration(kept, ARM, held=True)
    opened = with_growth_open(plain, ARM)
    n, terms = len(plain.parameters), length_terms(ARM, [1])
    assert len(opened.root) == n + len(terms)
    for j, term in enumerate(terms):
        (name,) = term.basis[0].weights  # type: ignore[union-attr]
        made_k = sum(kept.temperature_range_c[name]) / 2 - kept.reference_temperature_c
        at = plain.parameters.index(ARM.layout.index(term.parameter))
        for warmer_k in (0.0, 10.0):
            row = opened.root[at] + (made_k + warmer_k) * opened.root[n + j]
            length_mm = max(abs(kept.constants[term.parameter]), 1.0)
            grown = warmer_k * EXPANSION_PER_K * length_mm
            certain = np.hypot(np.linalg.norm(plain.root[at]), grown)
            if abs(kept.constants[term.parameter]) > 10.0:
                np.testing.assert_allclose(np.linalg.norm(row), certain, rtol=1e-6)


def test_one_of_several_temperatures_stays_as_it_is() -> None:
    known = from_calibration(calibrate(measured(SEED, SHOP_C), ARM).calibration, ARM, held=True)
    assert known.terms
    assert with_growth_open(known, ARM) is known
    assert told_of_growth(known, ARM) == []
    silent = known.calibration.model_copy(
        update={"terms": [], "covariance": [], "covariance_of": []}
    )
    without = from_calibration(silent, ARM, held=True)  # it saw 11 K, and no growth
    assert with_growth_open(without, ARM) is without
    assert told_of_growth(without, ARM) == []


def test_one_whose_errors_hide_what_its_temperatures_make_is_open() -> None:
    """11 K over lengths of 20e-6 per kelvin move a tip by some 30 µm: of a disc far off its axis as
    much was left, and no term was worth it."""
    seen = calibrate(measured(SEED, SHOP_C), ARM).calibration
    silent = seen.model_copy(update={"terms": [], "covariance": [], "covariance_of": []})
    for left_um, is_open in ((5.0, False), (60.0, True)):
        missed = silent.model_copy(
            update={"provenance": {**silent.provenance, "heldout_without_outliers_um": left_um}}
        )
        baseline = from_calibration(missed, ARM, held=True)
        opened = with_growth_open(baseline, ARM)
        assert (opened is not baseline) == is_open
        assert bool(told_of_growth(baseline, ARM)) == is_open
    assert len(opened.terms) == len(length_terms(ARM, [1]))
    assert "missed its own readings by 60 µm" in told_of_growth(baseline, ARM)[0]

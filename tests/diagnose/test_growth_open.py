"""A calibration made at one temperature, and sessions that are warmer or colder."""

from __future__ import annotations

import numpy as np
import pytest
from test_expansions_left_free import ARM, ECCENTRIC, MATERIALS, ONE_C, measured

from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.diagnosis import Diagnosis, Finding
from armd.compensation.diagnose.fitting.free_expansion import (
    drop_growth,
    open_growth,
    report_growth,
)
from armd.compensation.diagnose.problem.baseline import from_calibration
from armd.compensation.diagnose.report.verdict import write_verdict
from armd.compensation.effects.thermal.link_expansion import EXPANSION_PER_K
from armd.compensation.identify.calibrate import calibrate
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.identify.thermal.terms import make_length_terms
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from support import synthetic

SEED = 2
SHOP_C = (15.0, 18.0, 23.0, 26.0)
ELSEWHERE_C = (17.0, 25.0)


@pytest.fixture(scope="module")
def kept() -> Calibration:
    """Of a room kept within a kelvin."""
    return calibrate(measured(SEED, ONE_C), ARM).calibration


def grows_per_k() -> dict[str, float]:
    """By link, what its material grows by, as `measured` draws it."""
    rng = np.random.default_rng(SEED)
    synthetic.disturbed(ARM, rng, 0.1)
    drawn = rng.choice(MATERIALS, ARM.n_joints)
    return {f"link {k}": float(per_k) for k, per_k in enumerate(drawn, 1)}


def check_growth(diagnosis: Diagnosis) -> list[Finding]:
    """Each growth that is named is right, each of a metal is named, all come first; the rest."""
    named = [f for f in diagnosis.findings if f.candidate.cause == "link_expansion"]
    assert list(diagnosis.findings[: len(named)]) == named
    true_per_k = grows_per_k()
    for finding, values, variances in zip(
        named, diagnosis.search.last.amplitudes, diagnosis.search.last.covariances, strict=False
    ):
        assert finding.probability > 0.9
        true = true_per_k[str(finding.candidate.location)]
        assert values == pytest.approx(true, abs=4.0 * float(np.sqrt(np.diag(variances).max())))
    links = {str(f.candidate.location) for f in named}
    assert {link for link, per_k in true_per_k.items() if per_k > 10e-6} - {"link 1"} <= links
    assert set(range(len(named))) <= set(diagnosis.written)
    return list(diagnosis.findings[len(named) :])


def errors_um(*models: Calibration, terms: tuple[Term, ...] = ()) -> list[float]:
    further = measured(SEED, ELSEWHERE_C, *terms)
    return [
        float(np.sqrt((evaluate(further, ARM, model).distance_um ** 2).mean())) for model in models
    ]


@pytest.mark.slow
def test_what_links_grow_is_reported_and_written(kept: Calibration) -> None:
    diagnosis = diagnose(measured(SEED, SHOP_C), ARM, kept)
    assert check_growth(diagnosis) == []
    warm = calibrate(measured(SEED, SHOP_C), ARM).calibration  # of the same readings
    before, after, possible = errors_um(kept, diagnosis.extended, warm)
    assert after < 1.05 * possible < 0.25 * before
    assert "has no thermal model" in write_verdict(diagnosis)


@pytest.mark.slow
def test_a_disc_is_found_beside_it_and_both_are_written(kept: Calibration) -> None:
    diagnosis = diagnose(measured(SEED, SHOP_C, ECCENTRIC), ARM, kept)
    others = check_growth(diagnosis)
    assert [f.candidate.place for f in others] == [("encoder_eccentricity", "joint 3")]
    before, after = errors_um(kept, diagnosis.extended, terms=(ECCENTRIC,))
    assert after < 0.2 * before


def test_at_its_temperature_its_lengths_are_as_certain_as_before(kept: Calibration) -> None:
    """And 10 K warmer by 10 × 20e-6 of each length less, whichever constants were identified."""
    plain = from_calibration(kept, ARM, is_given=True)
    opened = open_growth(plain, ARM)
    n = len(plain.parameters)
    np.testing.assert_array_equal(opened.root[:n, : plain.root.shape[1]], plain.root)
    assert not opened.root[:n, plain.root.shape[1] :].any()
    assert len(opened.growth) == len(make_length_terms(ARM, [1]))
    for j, number in enumerate(opened.growth):
        term = opened.model.terms[number]
        (factor,) = term.basis
        assert isinstance(factor, Temperature) and term.coefficient == 0.0
        (name,) = factor.weights
        assert factor.reference_c == pytest.approx(sum(kept.temperature_range_c[name]) / 2)
        length_mm = max(abs(kept.constants[term.parameter]), 1.0)
        grown = np.linalg.norm(opened.root[n + j])
        assert grown == pytest.approx(EXPANSION_PER_K * length_mm, rel=1e-6) or length_mm < 10.0
    still = drop_growth(opened)
    np.testing.assert_allclose(still.root @ still.root.T, plain.root @ plain.root.T, rtol=1e-6)
    assert (still.terms, still.growth, still.model.terms) == (plain.terms, (), plain.model.terms)


@pytest.mark.slow
def test_one_of_several_temperatures_stays_as_it_is() -> None:
    known = from_calibration(calibrate(measured(SEED, SHOP_C), ARM).calibration, ARM, is_given=True)
    assert known.terms
    assert open_growth(known, ARM) is known
    assert report_growth(open_growth(known, ARM)) == []
    silent = known.calibration.model_copy(
        update={"terms": [], "covariance": [], "covariance_of": []}
    )
    without = from_calibration(silent, ARM, is_given=True)  # it saw 11 K, and no growth
    assert open_growth(without, ARM) is without
    assert report_growth(open_growth(without, ARM)) == []


@pytest.mark.slow
def test_one_whose_errors_hide_what_its_temperatures_make_is_open() -> None:
    """11 K over lengths of 20e-6 per kelvin move a tip by some 30 µm: of a disc far off its axis as
    much was left, and no term was worth it."""
    seen = calibrate(measured(SEED, SHOP_C), ARM).calibration
    silent = seen.model_copy(update={"terms": [], "covariance": [], "covariance_of": []})
    for heldout_um, is_open in ((5.0, False), (60.0, True)):
        missed = silent.model_copy(
            update={"provenance": {**silent.provenance, "heldout_without_outliers_um": heldout_um}}
        )
        baseline = from_calibration(missed, ARM, is_given=True)
        opened = open_growth(baseline, ARM)
        assert (opened is not baseline) == is_open
        assert bool(report_growth(opened)) == is_open
    assert len(opened.terms) == len(make_length_terms(ARM, [1]))
    assert "missed its own readings by 60 µm" in report_growth(opened)[0]


def guess_growth(known: Calibration, link: int, by_per_k: float) -> Calibration:
    """The same as if all sensors but t1 had stayed from 20 to 22 °C, and this link's coefficients
    were off *by_per_k* and as uncertain: at 21 °C its lengths are right all the same."""
    ranges = {
        name: (low, high) if name == "t1" else (20.0, 22.0)
        for name, (low, high) in known.temperature_range_c.items()
    }
    names, constants, terms = known.covariance_of, dict(known.constants), list(known.terms)
    covariance = np.array(known.covariance).reshape(len(names), len(names))
    for i, term in enumerate(known.terms):
        (factor,) = term.basis
        assert isinstance(factor, Temperature)
        if f"t{link}" not in factor.weights:
            continue
        off = by_per_k * known.constants[term.parameter]
        moved_mm = -off * (21.0 - known.reference_temperature_c)
        terms[i] = term.model_copy(update={"coefficient": term.coefficient + off})
        constants[term.parameter] += moved_mm
        moves = np.zeros(len(names))
        moves[names.index(f"term {i}")] = off
        moves[names.index(term.parameter)] = moved_mm
        covariance += np.outer(moves, moves)
    return known.model_copy(
        update={
            "temperature_range_c": ranges,
            "constants": constants,
            "terms": terms,
            "covariance": covariance.ravel().tolist(),
        }
    )


@pytest.fixture(scope="module")
def known() -> Calibration:
    """Of four temperatures, with coefficients of the first order."""
    calibration = calibrate(measured(SEED, SHOP_C), ARM).calibration
    assert {factor.order for term in calibration.terms for factor in term.basis} == {1}  # type: ignore[union-attr]
    return calibration


@pytest.mark.slow
def test_coefficients_of_lengths_at_one_temperature_are_open(known: Calibration) -> None:
    baseline = from_calibration(guess_growth(known, 3, 15e-6), ARM, is_given=True)
    opened = open_growth(baseline, ARM)
    names = [opened.model.terms[i].parameter for i in opened.growth]
    assert set(names) == {t.parameter for t in known.terms} - {"d_1", "a_1"}
    assert (opened.model, opened.terms) == (baseline.model, baseline.terms)
    np.testing.assert_array_equal(opened.root, baseline.root)
    closed = drop_growth(opened)
    assert closed.model.terms == baseline.model.terms  # none loses its coefficient
    assert [closed.model.terms[i].parameter for i in closed.terms] == [
        term.parameter for term in known.terms if term.parameter in ("d_1", "a_1")
    ]
    assert not closed.growth


@pytest.mark.slow
def test_a_coefficient_guessed_at_one_temperature_is_corrected(known: Calibration) -> None:
    guessed = guess_growth(known, 3, 15e-6)
    diagnosis = diagnose(measured(SEED, SHOP_C), ARM, guessed)
    (finding,) = diagnosis.findings
    assert finding.candidate.place == ("link_expansion", "link 3")
    (amplitude,) = diagnosis.search.last.amplitudes
    assert amplitude == pytest.approx(-15e-6, rel=0.1)
    assert "too little to know their growth" in write_verdict(diagnosis)
    wrong, mended, right = errors_um(guessed, diagnosis.extended, known)
    assert mended < 1.05 * right < 0.5 * wrong

"""The thermal model: no more than the temperatures left out ask for, and no less."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.identify.evaluation.evaluate import evaluate, evaluate_model
from armd.compensation.identify.fit import compute_rms_um
from armd.compensation.identify.result import Result
from armd.compensation.identify.thermal.per_temperature import make_regression
from armd.compensation.identify.thermal.temperatures import (
    group_temperatures,
    validate_by_temperature,
)
from armd.compensation.identify.thermal.terms import make_angle_terms, make_length_terms
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from support import synthetic
from support.selection import parametrize_default

ARM = synthetic.arm()
ARCSEC = np.pi / 180 / 3600
TEMPERATURES_C = (14.0, 18.0, 21.0, 25.0, 29.0, 33.0)


def with_coefficients(terms: list[Term], *by_order: float) -> list[Term]:
    return [
        term.model_copy(update={"coefficient": by_order[term.basis[0].order - 1]}) for term in terms
    ]


def measured(seed: int, celsius: Iterable[float], **more: Any) -> list[Session]:
    """A session at each temperature, by one arm."""
    rng = np.random.default_rng(seed)
    truth = synthetic.disturbed(ARM, rng, 0.2)
    return [
        synthetic.session(ARM, truth, rng, temperature_c=c, name=f"T{c:.1f}", **more)
        for c in celsius
    ]


def calibrated(true_terms: list[Term], options: Options | None = None) -> Result:
    rng = np.random.default_rng(7)
    truth = synthetic.disturbed(ARM, rng, 0.2)
    sessions = [
        synthetic.session(
            ARM, truth, rng, terms=true_terms, readings=80, targets=5, temperature_c=celsius,
            encoder_rad=0.5 * ARCSEC, name=f"T{celsius:.0f}",
        )
        for celsius in TEMPERATURES_C
    ]  # fmt: skip
    result = calibrate(sessions, ARM, options or Options())
    # However it was chosen, the model holds at a temperature that took no part. Components know
    # one temperature for all links, so what tells these apart (0.3 K here) stays uncorrected.
    fresh = synthetic.session(ARM, truth, rng, terms=true_terms, temperature_c=23.0)
    held = evaluate_model(
        collect_observations([fresh], ARM),
        result.fit.constants,
        result.fit.terms,
        ARM.reference_temperature_c,
    )
    assert held.rms_um < 5
    return result


@pytest.mark.slow
def test_no_expansion_no_thermal_model() -> None:
    result = calibrated([])
    assert result.thermal_order == 0
    assert result.calibration.terms == []


def test_linear_expansion_is_order_1() -> None:
    result = calibrated(with_coefficients(make_length_terms(ARM, [1]), 5e-3))
    assert result.thermal_order == 1
    coefficients = [term.coefficient for term in result.calibration.terms]
    uncertainties = [term.standard_uncertainty for term in result.calibration.terms]
    deviations = (np.array(coefficients) - 5e-3) / np.array(uncertainties)
    tip = np.array([term.parameter.startswith("tip") for term in result.calibration.terms])
    assert np.abs(deviations[~tip]).max() < 4


@pytest.mark.parametrize("placements", [1, 3])
def test_one_temperature_between_two_does_not_hide_the_expansion(placements: int) -> None:
    """A fit without temperatures is right at the mean of them, which the one between is."""
    terms = with_coefficients(make_length_terms(ARM, [1]), 3e-3)
    more = {"readings": 60, "placements": placements, "scatter_k": 0.02, "encoder_rad": ARCSEC}
    sessions = measured(placements, (15.0, 20.0, 25.0), terms=terms, **more)
    result = calibrate(sessions, ARM)
    assert result.thermal_order == 1
    by_name = {trial.name: trial.heldout_rms_um for trial in result.trials}
    assert by_name["no thermal model"] > 2.0 * by_name["all at once, order 1"]


@pytest.mark.slow
def test_expansion_that_bends_is_order_2() -> None:
    assert (
        calibrated(with_coefficients(make_length_terms(ARM, [1, 2]), 5e-3, 3e-4)).thermal_order == 2
    )


@pytest.mark.slow
def test_an_angle_that_moves_with_temperature_is_taken_up() -> None:
    lengths = with_coefficients(make_length_terms(ARM, [1]), 5e-3)
    angles = with_coefficients(make_angle_terms(ARM, "theta"), 2.0 * ARCSEC)
    result = calibrated([*lengths, *angles])
    assert any(note.startswith("θ with temperature") for note in result.notes)


@pytest.mark.slow
def test_every_way_is_tried_on_the_same_data() -> None:
    result = calibrated(with_coefficients(make_length_terms(ARM, [1]), 5e-3))
    by_name = {trial.name: trial.heldout_rms_um for trial in result.trials}
    without = by_name.pop("no thermal model")
    assert len(by_name) == 4 + 2 + 8  # orders, zones and components, the paper's way, twice
    assert max(by_name.values()) < 0.5 * without


@pytest.mark.slow
@parametrize_default("method", ["zones", "components"])
def test_other_methods_can_be_chosen(method: str) -> None:
    terms = with_coefficients(make_length_terms(ARM, [1]), 5e-3)
    result = calibrated(terms, Options(thermal_method=method))
    bases = [term.basis[0] for term in result.calibration.terms]
    if method == "zones":
        assert all(basis.zone_c is not None for basis in bases)
    else:
        assert all(len(basis.weights) == 6 for basis in bases)


@pytest.mark.slow
@parametrize_default("offset", [False, True])
def test_the_papers_own_way_can_be_chosen(offset: bool) -> None:
    terms = with_coefficients(make_length_terms(ARM, [1]), 5e-3)
    options = Options(thermal_order=1, thermal_method="per-temperature", offset=offset)
    result = calibrated(terms, options)
    assert result.thermal_order == 1
    name = "per temperature, order 1" + " and offset" * offset
    by_name = {trial.name: trial.heldout_rms_um for trial in result.trials}
    assert (result.heldout_by, result.heldout_rms_um) == ("temperature", by_name[name])
    calibration = result.calibration
    assert calibration.provenance["thermal_method"] == "per-temperature"
    assert calibration.provenance["thermal_offset"] == ("identified" if offset else "0")
    # Every constant moves, by the mean of all sensors counted from the measured temperature
    # nearest the reference.
    assert {term.parameter for term in calibration.terms} >= {"theta_2", "a_2", "alpha_3", "tip_z"}
    (reference_c,) = {term.basis[0].reference_c for term in calibration.terms}
    assert reference_c == pytest.approx(21.0, abs=0.1)
    by_parameter = {term.parameter: term for term in calibration.terms}
    for parameter in ("d_3", "a_2", "d_5"):
        term = by_parameter[parameter]
        assert term.standard_uncertainty is not None
        assert 0 < term.standard_uncertainty < 1e-3
        assert abs(term.coefficient - 5e-3) < 5 * term.standard_uncertainty
    assert calibration.covariance_of[-1] == f"term {len(calibration.terms) - 1}"
    variances = np.diag(calibration.covariance)
    assert variances[-1] == pytest.approx(calibration.terms[-1].standard_uncertainty ** 2)


def test_c_is_what_makes_the_reference_differ() -> None:
    """Eq. 14: without C the polynomial meets what was identified nearest the reference."""
    temperature_c = np.array([16.0, 20.5, 24.0, 30.0])
    values = np.array([1.0, 3.0, 2.0, 7.0])
    from_c, linear = make_regression(temperature_c, 1, False, 20.0)
    p_ref, slope = linear @ values
    assert (from_c, p_ref) == (20.5, 3.0)
    rise = temperature_c - 20.5
    assert slope == pytest.approx(rise @ (values - 3.0) / (rise @ rise))
    assert make_regression(temperature_c, 1, True, 20.0)[1] @ values == pytest.approx(
        np.polyfit(rise, values, 1)[::-1]
    )


def test_placements_are_grouped_by_their_temperature() -> None:
    sessions = measured(1, (20.0, 26.0, 20.2), readings=30)
    groups = group_temperatures(collect_observations(sessions, ARM))
    assert [int(mask.sum()) for _, mask in groups] == [60, 30]
    assert [mean for mean, _ in groups] == pytest.approx([20.1, 26.0], abs=0.2)


@pytest.mark.slow
def test_placements_close_to_the_next_are_not_all_of_one_temperature() -> None:
    """A campaign of many days: no gap anywhere, and 11 K from the coldest to the warmest."""
    slope = Term(parameter="a_2", coefficient=6e-3, basis=[Temperature(weights={"t2": 1.0})])
    celsius = np.random.default_rng(2).permutation(np.arange(18.0, 29.1, 0.5))
    more = {"readings": 24, "scatter_k": 0.0, "encoder_rad": 1e-6}
    sessions = measured(2, celsius, terms=[slope], **more)
    observations = collect_observations(sessions, ARM)
    groups = group_temperatures(observations)
    assert [mean for mean, _ in groups] == sorted(mean for mean, _ in groups)
    assert (np.sum([mask for _, mask in groups], axis=0) == 1).all()
    spans = [np.ptp(observations.states.temperature_c[mask]) for _, mask in groups]
    assert len(groups) == 4 and max(spans) < 3.0
    found = calibrate(sessions, ARM)
    (told,) = [t for t in found.calibration.terms if t.parameter == "a_2"]
    assert told.coefficient == pytest.approx(6e-3, rel=0.1)
    assert found.rms_um < 10.0


@pytest.mark.slow
@parametrize_default(("per_k", "width_k", "order"), [(2e-5, 2.1, 1), (0.0, 2.1, 0), (2e-5, 0.6, 0)])
def test_close_temperatures_tell_expansion_where_there_is_some(
    per_k: float, width_k: float, order: int
) -> None:
    """Each less than 0.75 K from the next; more than that in all, or not."""
    rng = np.random.default_rng(4)
    truth = synthetic.disturbed(ARM, rng, 0.2)
    terms = [
        t.model_copy(update={"coefficient": per_k * truth[ARM.layout.index(t.parameter)]})
        for t in make_length_terms(ARM, [1])
    ]
    cold, warm = 20.0, 20.0 + width_k
    *sessions, warmer = [
        synthetic.session(
            ARM, truth, rng, terms=terms, readings=60, temperature_c=c, scatter_k=0.1,
            encoder_rad=2e-6, noise_mm=0.002, name=f"T{c:.1f}",
        )
        for c in (*np.linspace(cold, warm, 4), warm + 5.0)
    ]  # fmt: skip
    chosen, none = calibrate(sessions, ARM), calibrate(sessions, ARM, Options(thermal_order=0))
    assert chosen.thermal_order == order
    missed = [
        compute_rms_um(evaluate([warmer], ARM, found.calibration).residual_mm)
        for found in (chosen, none)
    ]
    assert missed[0] < 0.6 * missed[1] if order else missed[0] == pytest.approx(missed[1], rel=0.01)


@pytest.mark.parametrize("placements", [1, 2, 3, 4])
def test_every_reading_is_left_out_once_and_each_end_keeps_some(placements: int) -> None:
    sessions = measured(3, (15.0, 20.0, 25.0), readings=24, placements=placements)
    observations = collect_observations(sessions, ARM)
    groups = group_temperatures(observations)
    sets = validate_by_temperature(observations, groups)
    assert (np.sum([left.rows for left in sets], axis=0) == 1).all()
    for left in sets:
        own = groups[left.group][1]
        assert not (left.rows & left.stays).any()
        assert ((left.rows | left.stays) == own).all() or left.group == 1
        assert left.stays.any() == (left.group != 1)

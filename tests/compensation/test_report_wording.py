"""What pages say where a figure is not known, is one, or is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.report.calibration.tables import add_correlations
from armd.compensation.report.diagnosis.finding import _format_small_units
from armd.compensation.report.layout.page import Page
from armd.compensation.report.layout.units import Unit
from armd.compensation.report.sessions import add_session_facts
from armd.compensation.report.verification.page import NO_LENGTH, _list_results
from armd.compensation.verify.results import Deviation, Figure
from armd.compensation.verify.verdict import Judged
from support import synthetic
from support.small_arm import small_arm

ARM = synthetic.arm()


def test_a_session_without_times_has_no_duration_and_one_sensor_is_one() -> None:
    session = synthetic.session(ARM, ARM.nominal(), np.random.default_rng(1))
    nowhen = np.full(session.n, np.nan)
    timeless = replace(session, states=replace(session.states, time_s=nowhen))
    arm = small_arm()
    page = Page("Sessions")
    one = arm.model_copy(update={"temperature_sensor": arm.temperature_sensor[:1]})
    add_session_facts(page, [timeless], one)
    text = page.to_html()
    assert "nan" not in text and "not stated" in text
    assert "of the 1 sensor of the arm" in text


def test_correlations_of_what_nothing_determines_are_not_listed() -> None:
    """One placement: offsets of the first joint are absorbed by it."""
    session = synthetic.session(
        ARM, synthetic.disturbed(ARM, np.random.default_rng(3), 1.0), np.random.default_rng(4)
    )
    result = calibrate([session], ARM, Options(thermal_order=0))
    found = result.fit
    assert found.solution.null.shape[1] > 0
    page = Page("Calibration")
    add_correlations(page, found)
    text = page.to_html()
    assert "Not determined, and so not listed" in text
    names = np.array(found.unknowns.words(found.terms))
    absorbed = names[np.abs(found.solution.null).max(axis=1) > 1e-3]
    for name in absorbed:
        assert f">{name}<" not in text


def test_a_result_without_a_certified_length_has_none() -> None:
    results = (Deviation("SPHERE", 0.01, 0.0), Deviation("B1", 0.01, 0.0, 200.0))
    figure = Figure("p_form", "P_Form", "ISO", results)
    rows = _list_results(Judged(figure, "not judged", results[0], None), Unit("µm", 1e3, 2))
    assert [row[1] for row in rows] == [NO_LENGTH, "200.000"]


def test_an_amplitude_is_per_degree_where_the_plot_is_in_degrees() -> None:
    gain = {"name": "gain", "value": 1e-4, "standard_uncertainty": 1e-6, "unit": "rad/rad"}
    name, value, sigma, unit = _format_small_units(gain)
    assert (name, unit) == ("gain", "″/°")
    assert float(value) == 0.360 and float(sigma) == 0.0036

"""A reflector seated again: the tip that suits the sessions, and the hint that one would."""

from __future__ import annotations

import re

import numpy as np
import pytest

from armd import BadInput
from armd.compensation.data.sessions.session import Session
from armd.compensation.identify.evaluation import seated_again
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.identify.evaluation.outside_range import OutsideRange
from armd.compensation.identify.evaluation.seated_again import fit_tip, make_tip_hint, replace_tip
from armd.compensation.model.calibration import Calibration
from support import synthetic
from support.drawn import drawn
from support.small_arm import small_arm, thermal_calibration

ARM = synthetic.arm()
MOVED_MM = np.array([0.8, -0.5, 0.6])
NOISE_MM = 0.02


def seated(moved_mm: np.ndarray) -> Session:
    truth = ARM.nominal()
    truth[ARM.layout.tip] += moved_mm
    return synthetic.session(ARM, truth, np.random.default_rng(2), noise_mm=NOISE_MM)


def test_the_tip_is_found_and_the_rest_is_noise() -> None:
    session = seated(MOVED_MM)
    tip = fit_tip([session], ARM, None)
    off = tip.offset_mm - (np.array(ARM.tip.offset_mm) + MOVED_MM)
    assert (np.abs(off) < 4 * tip.standard_uncertainty_mm).all()
    assert (tip.standard_uncertainty_mm < NOISE_MM).all()
    before = evaluate([session], ARM, None)
    after = evaluate([session], *replace_tip(ARM, None, tip))
    assert before.rms_um > 300.0
    assert after.rms_um == pytest.approx(1e3 * NOISE_MM * np.sqrt(3.0), rel=0.15)
    assert make_tip_hint(ARM, None, before) == []  # a drawing misses by more than its tip


def nominal_calibration() -> Calibration:
    return drawn(ARM, reference_temperature_c=ARM.reference_temperature_c)


def test_one_linear_step_tells_of_the_tip_as_a_whole_fit_does(monkeypatch) -> None:
    session, calibration = seated(MOVED_MM), nominal_calibration()
    before = evaluate([session], ARM, calibration)
    tip = fit_tip([session], ARM, calibration)
    after = evaluate([session], *replace_tip(ARM, calibration, tip))
    monkeypatch.setattr(seated_again, "fit", None)  # a whole fit is not called
    (hint,) = make_tip_hint(ARM, calibration, before)
    assert "--fit-tip" in hint and f"{before.rms_um:.4g}" in hint
    moved_mm, rms_um = map(float, re.findall(r"(?:by|are) ([0-9.]+)", hint))
    assert moved_mm == pytest.approx(tip.moved_mm, abs=0.02)
    assert rms_um == pytest.approx(after.rms_um, rel=0.02)


def test_no_hint_where_the_tip_is_right() -> None:
    session = seated(np.zeros(3))
    calibration = nominal_calibration()
    assert make_tip_hint(ARM, calibration, evaluate([session], ARM, calibration)) == []


def test_too_few_readings_give_no_tip() -> None:
    with pytest.raises(BadInput, match="to fit the tip"):
        fit_tip([seated(MOVED_MM).rows(np.arange(8))], ARM, None)


def test_temperatures_outside_the_range_are_told_by_session_and_sensor() -> None:
    """Sensor b: 15 to 30 °C; c belongs to no joint. In pieces as at once."""
    arm = small_arm()
    outside = OutsideRange(arm, thermal_calibration(arm).content)
    celsius = np.array([[20.0, 29.0, 90.0], [20.0, 33.5, 20.0], [20.0, np.nan, 20.0]])
    outside.add(0, "warm", celsius)
    outside.add(0, "warm", celsius + np.array([0.0, 1.0, 0.0]))
    outside.add(1, "mild", celsius[:1])
    (told,) = outside.in_words()
    assert told.startswith("warm: ") and "of 6 readings: b 33.5 to 34.5 °C in 2" in told
    assert OutsideRange(arm, None).in_words() == []

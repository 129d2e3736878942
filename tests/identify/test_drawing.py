"""A wrong drawing is remarked on; a right one, or a tip that no drawing knows, refuses nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.identify.certificate import Misses, judge
from armd.compensation.identify.drawing import find_off_nominal
from armd.compensation.identify.heldout import Errors
from armd.compensation.identify.result import Result
from armd.compensation.model.arm import Arm
from support import synthetic

ARCSEC = np.pi / 180 / 3600
OPTIONS = Options(thermal_order=0)


def with_joint(arm: Arm, number: int, **off: float) -> Arm:
    """*arm* with joint *number* off by *off* in arm.toml's own units."""
    joint = arm.joint[number - 1]
    changed = joint.model_copy(update={name: getattr(joint, name) + by for name, by in off.items()})
    joints = [*arm.joint[: number - 1], changed, *arm.joint[number:]]
    return arm.model_copy(update={"joint": type(arm.joint)(joints)})


def with_tip(arm: Arm, *offset_mm: float) -> Arm:
    return arm.model_copy(update={"tip": arm.tip.model_copy(update={"offset_mm": offset_mm})})


ARM = with_joint(synthetic.arm(), 2, a_mm=360.0)  # of 400 mm: 60 mm are a typing error
SHORT = with_joint(ARM, 2, a_mm=-60.0)


def calibrated(drawing: Arm, size: float = 1.0, seed: int = 3, **settings: float) -> Result:
    """Of readings by an arm that is up to *size* mm and 0.5° times *size* off ARM."""
    rng = np.random.default_rng(seed)
    truth = synthetic.disturbed(ARM, rng, size)
    session = synthetic.session(ARM, truth, rng, **{"encoder_rad": 5 * ARCSEC, **settings})  # type: ignore[arg-type]
    return calibrate([session], drawing, OPTIONS)


@pytest.mark.parametrize(
    ("drawing", "differences", "place"),
    [
        (ARM, {}, ""),
        (with_tip(ARM, 0.0, 0.0, 0.0), {"tip_x": 10.0, "tip_y": 20.0, "tip_z": 120.0}, "tip"),
        (SHORT, {"a_2": 60.0}, "joint 2"),
        (with_joint(ARM, 3, alpha_deg=3.0), {"alpha_3": -3.0}, "joint 3"),
        (with_joint(ARM, 4, theta_deg=-12.0), {"theta_4": 12.0}, "zero of joint 4's encoder"),
    ],
)
def test_what_is_far_off_is_remarked(
    drawing: Arm, differences: dict[str, float], place: str
) -> None:
    result = calibrated(drawing)
    assert result.certificate.granted, result.certificate.reason
    far = result.off_drawing
    assert [one.parameter for one in far] == list(differences)
    for one in far:
        # The true arm is up to 1 mm and 0.5° off ARM; what it is off by at joint 6 is in the tip.
        slack = 0.6 if one.unit == "°" else 3.0 if one.place == "tip" else 1.1
        assert one.difference == pytest.approx(differences[one.parameter], abs=slack)
        assert one.place == place
        assert one.in_words() in result.notes
        assert one.in_brief() in result.certificate.reason
    assert result.as_json()["off_drawing"] == [one.as_json() for one in far]
    assert result.calibration.provenance["off_drawing"] == [one.as_json() for one in far]
    assert ("arm.toml is far off" in result.certificate.reason) == bool(far)


@pytest.mark.slow
def test_a_remark_has_its_units_and_its_reason() -> None:
    (length,) = calibrated(SHORT).off_drawing
    assert length.in_words().startswith("arm.toml may be wrong: a_2 (joint 2) is 340.00 mm there")
    (angle,) = calibrated(with_joint(ARM, 4, theta_deg=-12.0)).off_drawing
    assert "is -12.00° there" in angle.in_words()
    assert "was the joint homed? theta_4 is no part of a drawing" in angle.in_words()


@pytest.mark.parametrize(("uncertainty_mm", "sure"), [(19.0, True), (21.0, False)])
def test_what_is_not_sure_is_not_remarked(uncertainty_mm: float, sure: bool) -> None:
    """60 mm are three times 20 mm."""
    found = calibrated(SHORT).fit
    at = found.unknowns.constants.index("a_2")
    covariance = np.zeros_like(found.covariance)
    covariance[at, at] = uncertainty_mm**2
    far = find_off_nominal(replace(found, covariance=covariance))
    assert ["a_2"] * sure == [one.parameter for one in far]
    assert all(one.standard_uncertainty == pytest.approx(uncertainty_mm) for one in far)


def test_an_arm_whose_size_nothing_measured_is_not_remarked() -> None:
    """Each length 4 % longer, up to 16 mm: one ball in one place fits an arm of any size."""
    scaled = ARM.model_copy(deep=True)
    for number, joint in enumerate(ARM.joint, 1):
        scaled = with_joint(scaled, number, a_mm=0.04 * joint.a_mm, d_mm=0.04 * joint.d_mm)
    scaled = with_tip(scaled, *(1.04 * each for each in ARM.tip.offset_mm))
    settings = {"targets": 1, "placements": 1, "readings": 60, "known": False}
    assert calibrated(scaled, 0.3, **settings).off_drawing == []


@pytest.mark.parametrize(("encoder_arcsec", "readings"), [(0.0, 150), (0.5, 150), (5.0, 90)])
def test_an_arm_that_is_as_drawn_is_granted(encoder_arcsec: float, readings: int) -> None:
    result = calibrated(ARM, 0.0, encoder_rad=encoder_arcsec * ARCSEC, readings=readings)
    assert result.certificate.granted, result.certificate.reason
    assert result.off_drawing == []


def test_the_same_readings_have_the_same_verdict_whatever_tip_the_drawing_has() -> None:
    """A tracker's reflector is in no drawing: 68 mm from arm.toml's tip, or just there."""
    rng = np.random.default_rng(1)
    seen = synthetic.tracked(ARM, synthetic.disturbed(ARM, rng, 0.02), rng)
    seen.states.q[:] += 20 * ARCSEC * rng.normal(size=seen.states.q.shape)
    results = [calibrate([seen], arm, OPTIONS) for arm in (ARM, with_tip(ARM, 10.0, 20.0, 52.0))]
    for result in results:
        assert result.certificate.granted, result.certificate.reason
        assert "what is left is noise, or what no constants describe" in result.certificate.reason
    told = [result.certificate.reason.partition("%")[0] for result in results]
    assert told[0] == told[1]
    assert [[one.parameter for one in result.off_drawing] for result in results] == [[], ["tip_z"]]


@pytest.mark.parametrize(
    ("drawn_um", "noise_um", "heldout_um", "granted"),
    [
        (100.0, 10.0, 49.0, True),
        (100.0, 10.0, 51.0, False),
        (100.0, 50.0, 62.0, True),
        (100.0, 50.0, 63.0, False),
        (50.0, 50.0, 62.0, True),
        (0.0, 50.0, 62.0, True),
    ],
)
def test_half_of_the_drawings_error_or_the_noise(
    drawn_um: float, noise_um: float, heldout_um: float, granted: bool
) -> None:
    result = calibrated(ARM)
    errors = Errors(heldout_um, heldout_um, 0)
    misses = Misses(drawn_um, noise_um, errors, "placement")
    record = judge(result.fit, True, misses, result.lengths)
    assert record.granted == granted
    assert ("shows a calibration to help" in record.reason) != granted

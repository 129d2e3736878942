"""A drawing that is wrong is remarked on; what no drawing knows is no reason to refuse."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.model.arm import Arm
from support import synthetic

ARM = synthetic.arm()
NO_TIP = ARM.tip.model_copy(update={"offset_mm": (0.0, 0.0, 0.0)})
ARCSEC = np.pi / 180 / 3600


def with_joint(number: int, **off: float) -> Arm:
    """ARM with joint *number* off by *off* in arm.toml's own units."""
    joint = ARM.joint[number - 1]
    changed = joint.model_copy(update={name: getattr(joint, name) + by for name, by in off.items()})
    joints = [*ARM.joint[: number - 1], changed, *ARM.joint[number:]]
    return ARM.model_copy(update={"joint": type(ARM.joint)(joints)})


@pytest.mark.parametrize(
    ("drawing", "parameter", "difference"),
    [
        (ARM, "", 0.0),
        (ARM.model_copy(update={"tip": NO_TIP}), "tip", 0.0),
        (with_joint(2, a_mm=-20.0), "a_2", 20.0),
        (with_joint(3, alpha_deg=3.0), "alpha_3", -3.0),
    ],
)
def test_what_is_far_off_is_remarked(drawing: Arm, parameter: str, difference: float) -> None:
    rng = np.random.default_rng(3)
    truth = synthetic.disturbed(ARM, rng)
    session = synthetic.session(ARM, truth, rng, placements=3, encoder_rad=5 * ARCSEC)
    result = calibrate([session], drawing, Options(thermal_order=0))
    assert result.certificate.granted, result.certificate.reason
    far = result.off_drawing
    assert ("far off" in result.certificate.reason) == bool(parameter)
    assert result.as_json()["off_drawing"] == [one.as_json() for one in far]
    if parameter == "tip":
        assert far and all(one.place == "tip" for one in far)
    else:
        assert [one.parameter for one in far] == [parameter] * bool(parameter)
    for one in far:
        assert one.in_words() in result.notes
        if difference:
            assert abs(one.difference - difference) < max(3 * one.standard_uncertainty, 1.0)

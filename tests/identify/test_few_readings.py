"""Readings too few for an arm's constants: the drawing holds the rest, and it helps."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.errors import BadInput
from support import synthetic
from support.selection import parametrize_default

ARM = synthetic.arm(9)
OPTIONS = Options(thermal_order=0)


@parametrize_default(
    ("readings", "placements", "targets"), [(15, 1, 4), (15, 2, 1), (61, 20, 2)], default=2
)
def test_a_nine_joint_arm_gains_tenfold(readings: int, placements: int, targets: int) -> None:
    rng = np.random.default_rng(0)
    truth = synthetic.disturbed(ARM, rng)
    few = synthetic.session(
        ARM, truth, rng, readings=readings, placements=placements, targets=targets,
        known=targets == 4, distances=[(0, 1)] if targets == 2 else [], encoder_rad=5e-6,
    )  # fmt: skip
    fresh = synthetic.session(ARM, truth, rng, readings=100)
    result = calibrate([few], ARM, OPTIONS)
    assert not result.certificate.granted
    drawn = evaluate([fresh], ARM, None)
    assert evaluate([fresh], ARM, result.calibration).rms_um < 0.1 * drawn.rms_um


@pytest.mark.parametrize("readings", [1, 2, 3, 4, 5])
def test_next_to_nothing_is_refused_or_fitted(readings: int) -> None:
    """No traceback, however few; what the readings do not tell stays near the drawing."""
    rng = np.random.default_rng(1)
    session = synthetic.session(
        ARM, ARM.nominal(), rng, readings=readings, placements=1, encoder_rad=5e-6
    )
    try:
        result = calibrate([session], ARM, OPTIONS)
    except BadInput as refused:
        assert "readings: found" in str(refused) or "poses: found" in str(refused)
    else:
        assert not result.certificate.granted
        assert np.abs(result.fit.departure[:4]).max() < 1.0

"""The certificate: granted where a calibration helps and describes the arm, refused in words."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic

from armd.compensation.identify.calibrate import Options, calibrate

ARM = synthetic.arm()
ARCSEC = np.pi / 180 / 3600


@pytest.mark.parametrize(
    ("size", "encoder_arcsec", "placements", "words"),
    [
        (1.0, 5.0, 3, ""),
        (1.0, 5.0, 1, ""),  # readings are left out instead of placements
        (0.0, 5.0, 3, "more than the 50% that shows a calibration to help"),
        (3.0, 900.0, 3, "more than 1 mm: no set of constants describes this arm"),
    ],
)
def test_certificate(size: float, encoder_arcsec: float, placements: int, words: str) -> None:
    rng = np.random.default_rng(3)
    truth = synthetic.disturbed(ARM, rng, size)
    session = synthetic.session(
        ARM, truth, rng, placements=placements, encoder_rad=encoder_arcsec * ARCSEC
    )
    result = calibrate([session], ARM, Options(thermal_order=0))
    certificate = result.certificate
    assert certificate.granted == (words == ""), certificate.reason
    assert words in certificate.reason
    left_out = "placement" if placements > 1 else "reading"
    assert certificate.reason.startswith(f"each {left_out} left out misses by ")
    assert result.calibration.provenance["certificate"] == {
        "granted": certificate.granted,
        "reason": certificate.reason,
    }

"""What a diagnosis holds sessions against where no calibration is given."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.data.session import Session
from armd.compensation.diagnose.fitting.under_test import model_under_test
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.identify.thermal.comparison import Comparison
from armd.compensation.identify.thermal.terms import length_terms
from support import synthetic

ARM = synthetic.arm()


def sessions(*celsius: float) -> list[Session]:
    """Of an arm whose lengths grow in a curve: by itself `armd calibrate` takes a second order."""
    rng = np.random.default_rng(5)
    terms = [
        t.model_copy(update={"coefficient": (5e-3, 3e-4)[t.basis[0].order - 1]})
        for t in length_terms(ARM, [1, 2])
    ]
    truth = synthetic.disturbed(ARM, rng, 0.3)
    return [
        synthetic.session(
            ARM, truth, rng, terms=terms, temperature_c=c, readings=120, name=f"{c}"
        )
        for c in celsius
    ]  # fmt: skip


def test_it_is_the_linear_one_which_calibrate_makes_when_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured = sessions(10.0, 16.0, 22.0, 28.0, 34.0)
    assert calibrate(measured, ARM).thermal_order == 2
    told = calibrate(measured, ARM, Options(thermal_order=1)).calibration
    monkeypatch.setattr(Comparison, "trials", None)  # no other is tried
    found = model_under_test(measured, ARM, None)[0].calibration
    assert found.model_dump(exclude={"created"}) == told.model_dump(exclude={"created"})


def test_at_one_temperature_it_is_the_geometry_alone() -> None:
    found = model_under_test(sessions(20.0), ARM, None)[0]
    assert found.model.terms == () and found.calibration.provenance["thermal_order"] == 0

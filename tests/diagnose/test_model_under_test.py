"""What a diagnosis holds sessions against where no calibration is given."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.fitting.under_test import (
    make_model_and_judge_sessions,
)
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.identify.thermal.comparison import Comparison
from armd.compensation.identify.thermal.terms import make_length_terms
from support import synthetic

ARM = synthetic.arm()


def sessions(*celsius: float) -> list[Session]:
    """Of an arm whose lengths grow in a curve: by itself `armd calibrate` takes a second order."""
    rng = np.random.default_rng(5)
    terms = [
        t.model_copy(update={"coefficient": (5e-3, 3e-4)[t.basis[0].order - 1]})
        for t in make_length_terms(ARM, [1, 2])
    ]
    truth = synthetic.disturbed(ARM, rng, 0.3)
    return [
        synthetic.session(
            ARM, truth, rng, terms=terms, temperature_c=c, readings=120, name=f"{c}"
        )
        for c in celsius
    ]  # fmt: skip


@pytest.mark.slow
def test_it_is_the_linear_one_which_calibrate_makes_when_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured = sessions(10.0, 16.0, 22.0, 28.0, 34.0)
    assert calibrate(measured, ARM).thermal_order == 2
    told = calibrate(measured, ARM, Options(thermal_order=1)).calibration
    monkeypatch.setattr(Comparison, "trials", None)  # no other is tried
    found = make_model_and_judge_sessions(measured, ARM, None)[0].calibration
    assert found.model_dump(exclude={"created"}) == told.model_dump(exclude={"created"})


def test_at_one_temperature_it_is_the_geometry_alone() -> None:
    found = make_model_and_judge_sessions(sessions(20.0), ARM, None)[0]
    assert found.model.terms == () and found.calibration.provenance["thermal_order"] == 0


@pytest.mark.parametrize("moved_mm", [0.0, 3.0])
def test_the_inconsistent_session_is_looked_for_under_a_calibration_too(moved_mm: float) -> None:
    rng = np.random.default_rng(9)
    truth = synthetic.disturbed(ARM, rng, 0.3)
    other = truth.copy()
    other[ARM.layout.index("tip_x")] += moved_mm

    def session(name: str, constants: np.ndarray) -> Session:
        return synthetic.session(ARM, constants, rng, encoder_rad=5e-6, readings=60, name=name)

    calibration = calibrate([session("before", truth)], ARM).calibration
    measured = [session(f"S{k}", other if k == 2 else truth) for k in range(4)]
    _, odd = make_model_and_judge_sessions(measured, ARM, calibration)
    assert (odd.path.name if odd else None) == ("S2" if moved_mm else None)

"""A sealed calibration with an absurd coefficient: evaluate and verify refuse what overflows."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.calibration import Calibration, LoadedCalibration
from armd.compensation.verify.figures import correct_positions
from armd.errors import BadInput
from support import synthetic
from support.drawn import drawn

ARM = synthetic.arm()


def absurd(coefficient: float) -> Calibration:
    term = {"parameter": "a_2", "basis": [{"kind": "temperature", "weights": {"t2": 1.0}}]}
    return drawn(ARM, terms=[{**term, "coefficient": coefficient}])


def warm_row(rows: slice) -> Session:
    """At the reference temperature, where the term is nothing, but for some rows."""
    session = synthetic.session(ARM, ARM.nominal(), np.random.default_rng(2))
    celsius = session.states.temperature_c
    celsius[:] = 20.0
    celsius[rows] = 24.0
    celsius[0] = np.nan  # lacks a temperature: not used, and no overflow
    return session


@pytest.mark.parametrize("coefficient", [1e308, 1e200])
def test_rows_that_overflow_are_named(coefficient: float) -> None:
    session, calibration = warm_row(slice(4, 6)), absurd(coefficient)
    words = f"rows 5, 6.*not finite, in 2 of {session.n} readings"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(BadInput, match=words):
            evaluate([session], ARM, calibration)
        with pytest.raises(BadInput, match=words):
            correct_positions(
                session, ARM, LoadedCalibration(calibration, "0" * 64, Path("cal.json"))
            )

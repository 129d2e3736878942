"""A drift in sessions that grew warmer one after another: later ones tell time from warmth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armd.compensation.data.session import Session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.told.verdict import verdict
from armd.compensation.identify.calibrate import calibrate
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.terms import Term
from support import synthetic

ARM = synthetic.arm()
DAY_S = 86400.0
WARMER_C = (16.0, 20.0, 24.0, 28.0)
PER_DAY_RAD = 1.2e-5


def session(rng: np.random.Generator, day: int, celsius: float, turned_rad: float = 0.0) -> Session:
    turned = Term(parameter="theta_3", basis=[], coefficient=turned_rad)
    made = synthetic.session(
        ARM, ARM.nominal(), rng, terms=[turned], temperature_c=celsius, scatter_k=0.02,
        readings=60, encoder_rad=4e-6, noise_mm=0.001, name=f"day-{day}",
    )  # fmt: skip
    start_s = made.started_unix_s + day * DAY_S
    states = replace(made.states, time_s=made.states.time_s + day * DAY_S)
    return replace(made, started_unix_s=start_s, states=states)


def test_a_drift_that_went_with_the_temperature_is_found_by_what_is_held_out() -> None:
    """Joint 3 crept for three days, through its calibrated zero on the second, and stood still."""
    rng = np.random.default_rng(4)
    made = [session(rng, k - 40, c) for k, c in enumerate(WARMER_C)]
    calibration = calibrate(made, ARM).calibration
    crept_rad = (-PER_DAY_RAD, 0.0, PER_DAY_RAD, 2.0 * PER_DAY_RAD)
    days = enumerate(zip(WARMER_C, crept_rad, strict=True))
    sessions = [session(rng, day, c, turned) for day, (c, turned) in days]
    alone = diagnose(sessions, ARM, calibration)
    assert alone.found[0].candidate.place == ("joint_thermal", "joint 3")
    alternatives = [rival.candidate.place for rival in alone.found[0].rivals]
    assert ("geometry_shift", "joint 3") in alternatives

    days_c = ((5, 17.0), (6, 26.0), (7, 15.0))
    later = [session(rng, day, c, crept_rad[-1]) for day, c in days_c]
    diagnosis = diagnose(sessions, ARM, calibration, later)
    (found,) = diagnosis.found
    assert found.candidate.place == ("geometry_shift", "joint 3")
    assert found.candidate.depends_on == ("time_s",) and diagnosis.written == (0,)
    assert "refuted joint_thermal (joint 3, by t3)" in verdict(diagnosis)
    rms = [
        float(np.sqrt((evaluate(later, ARM, model).distance_um ** 2).mean()))
        for model in (calibration, alone.extended, diagnosis.extended)
    ]
    assert rms[2] < rms[0] < rms[1]

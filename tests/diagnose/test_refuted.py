"""A drift in sessions that grew warmer one after another: later ones tell time from warmth."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.heldout.refutation import (
    is_better,
    is_refuted,
    select_refuted,
)
from armd.compensation.diagnose.report.verdict import write_verdict
from armd.compensation.identify.calibrate import calibrate
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.terms import Term
from support import synthetic
from support.small_fit import candidate

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


@pytest.mark.slow
def test_a_drift_that_went_with_the_temperature_is_found_by_what_is_held_out() -> None:
    """Joint 3 crept for three days, through its calibrated zero on the second, and stood still."""
    rng = np.random.default_rng(4)
    made = [session(rng, k - 40, c) for k, c in enumerate(WARMER_C)]
    calibration = calibrate(made, ARM).calibration
    crept_rad = (-PER_DAY_RAD, 0.0, PER_DAY_RAD, 2.0 * PER_DAY_RAD)
    days = enumerate(zip(WARMER_C, crept_rad, strict=True))
    sessions = [session(rng, day, c, turned) for day, (c, turned) in days]
    alone = diagnose(sessions, ARM, calibration)
    assert alone.findings[0].candidate.place == ("joint_thermal", "joint 3")
    alternatives = [rival.candidate.place for rival in alone.findings[0].rivals]
    assert ("geometry_shift", "joint 3") in alternatives

    days_c = ((5, 17.0), (6, 26.0), (7, 15.0))
    later = [session(rng, day, c, crept_rad[-1]) for day, c in days_c]
    diagnosis = diagnose(sessions, ARM, calibration, later)
    (found,) = diagnosis.findings
    assert found.candidate.place == ("geometry_shift", "joint 3")
    assert found.candidate.depends_on == ("time_s",) and diagnosis.written == (0,)
    assert "refuted joint_thermal (joint 3, by t3)" in write_verdict(diagnosis)
    rms = [
        float(np.sqrt((evaluate(later, ARM, model).distance_um ** 2).mean()))
        for model in (calibration, alone.extended, diagnosis.extended)
    ]
    assert rms[2] < rms[0] < rms[1]


def described(
    interval_um: tuple[float, float], *, written: bool = False, contradicted_later: bool = False,
    cause: str = "joint_thermal", rms_um: float = 5.0,
) -> Any:  # fmt: skip
    """What a diagnosis says of one finding."""
    return SimpleNamespace(
        findings=(SimpleNamespace(candidate=candidate(cause, 3)),),
        gains=(SimpleNamespace(interval_um=interval_um),),
        written=(0,) if written else (),
        contradicted_later=(0,) if contradicted_later else (),
        written_rms_um=(6.0, rms_um),
    )


@pytest.mark.parametrize(
    ("diagnosis", "refuted"),
    [
        (described((-2.0, -0.5)), True),  # worse beyond doubt
        (described((-2.0, 0.5)), False),
        (described((-2.0, 0.5), contradicted_later=True), True),
        (described((0.5, 2.0), written=True), False),
        (described((-2.0, -0.5), cause="unknown"), False),
    ],
)
def test_a_finding_is_refuted_by_held_out_readings_beyond_doubt(
    diagnosis: Any, refuted: bool
) -> None:
    assert bool(select_refuted(diagnosis)) is refuted


def test_what_is_refuted_bars_its_place_and_what_has_no_name_by_the_same() -> None:
    by_warmth = replace(candidate("joint_thermal", 3), depends_on=("t3",))
    assert is_refuted(by_warmth, [by_warmth])
    assert not is_refuted(replace(candidate("joint_thermal", 4), depends_on=("t4",)), [by_warmth])
    assert is_refuted(replace(candidate("unknown", 5), depends_on=("t5",)), [by_warmth])
    assert not is_refuted(candidate("unknown", 5), [by_warmth])  # it goes by an angle
    assert not is_refuted(by_warmth, [])


def test_the_diagnosis_without_it_counts_where_it_writes_and_predicts_better() -> None:
    before = described((-2.0, -0.5), rms_um=5.0)
    assert is_better(described((0.5, 2.0), written=True, rms_um=4.0), before)
    assert not is_better(described((0.5, 2.0), written=True, rms_um=5.5), before)
    assert not is_better(described((-2.0, 0.5), rms_um=4.0), before)

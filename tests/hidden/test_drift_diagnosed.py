"""What drifts is told as a drift: with its course and its time constant, never as a staircase."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from drifts import run_drift, said

from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.report.result import as_json
from armd.simulator.campaigns.hidden import Design
from armd.simulator.truth import course
from support.known_regression import known_regression
from support.long_case import long_case
from support.made_case import make_case
from support.planting import of_joint, planted

HOUR_S = 3600.0


@pytest.fixture(scope="module")
def healthy() -> Any:
    """Five sessions, four hours apart, of an arm with nothing wrong."""
    made = make_case(631, (), Design(sessions=5, articulations=3, holdout=0))
    return made.arm, made.sessions


@pytest.mark.slow
def test_a_zero_that_relaxes_has_its_time_constant(healthy: Any) -> None:
    arm, sessions = healthy
    start_s = sessions[0].states.time_s[0]
    relaxing = course.make_relaxing(start_s, 5.0 * HOUR_S)
    found = diagnose(planted(sessions, of_joint(3, lambda s: 12.0 * relaxing(s.time_s))), arm)
    (one,) = said(found)
    assert (one.cause, one.location, one.stepped) == ("geometry_shift", "joint 3", False)
    (finding,) = as_json(found, None)["findings"]
    values = {p["name"]: (p["value"], p["standard_uncertainty"]) for p in finding["parameters"]}
    tau, sigma = values["time constant"]
    assert 0.0 < sigma < 0.3 * tau
    assert tau == pytest.approx(5.0 * HOUR_S, abs=4 * sigma)
    size, sigma = values["theta in the end"]
    assert abs(size) == pytest.approx(np.radians(12.0 / 3600.0), abs=5 * sigma)
    assert "theta of joint 3 relaxes with a time constant of" in finding["reading"]
    assert found.written == (0,)


@pytest.mark.slow
def test_a_joint_that_is_homed_anew_for_each_session_keeps_no_sessions_zero(healthy: Any) -> None:
    """By 9 to 20″, drawn for each: no walk, whose last value would stay."""
    arm, sessions = healthy
    off = dict(zip([s.name for s in sessions], (0.0, 15.0, -9.0, 20.0, 15.0), strict=True))
    moved = [
        planted([s], of_joint(3, lambda _, s=s: off[s.name] + np.zeros(s.n)))[0] for s in sessions
    ]
    found = diagnose(moved, arm)
    (one,) = said(found)
    assert (one.cause, one.location) == ("geometry_shift", "joint 3")
    (finding,) = as_json(found, None)["findings"]
    assert "the zero of joint 3 is another in each session" in finding["reading"]
    against = {p["name"]: (p["value"], p["standard_uncertainty"]) for p in finding["parameters"]}
    size, sigma = against[f"theta, {sessions[1].name} against those before"]
    assert abs(size) == pytest.approx(np.radians(15.0 / 3600.0), abs=5 * sigma)
    assert found.written == (0,)
    terms = [t for t in found.extended.terms if t.effect == "geometry_shift joint 3"]
    of_session = np.cumsum([t.coefficient for t in sorted(terms, key=_begins_s)])
    assert len(of_session) == len(sessions) + 1
    assert of_session[-1] == pytest.approx(0.0, abs=1e-12)  # after the last
    assert np.sort(of_session[:-1])[2] == pytest.approx(0.0, abs=1e-12)  # of the middle one


def _begins_s(term: Any) -> float:
    return float(term.basis[0].instant_unix_s)


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed",
    [
        8100,
        8403,
        pytest.param(7373080010, marks=known_regression("the wandering length is not named")),
        *map(long_case, [8104, 8110, 8408, 31337080002]),
    ],
)
def test_a_drift_is_no_staircase(seed: int) -> None:
    """The day; a wave that does not come again; a length that walks far within sessions; a creep, a
    mount that wanders, and again; a day that had gone its way before the first reading, beside
    which an expansion stood in."""
    found = run_drift("drift", seed)
    assert found.right, found
    assert found.worse < 0.002

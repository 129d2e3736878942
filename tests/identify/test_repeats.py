"""Copies of postures tell a calibration no more than each posture read once.

The truth is a set with each posture once: what the model gets wrong at a posture is the same in all
of its copies, and their scatter of 2 µm is nothing beside it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.identify.calibrate import calibrate
from armd.compensation.identify.result import Result
from support import synthetic

ERROR_MM, SCATTER_MM = 0.05, 0.002
ARM = synthetic.arm()


def read(postures: int, times: int, in_rounds: bool = False, seed: int = 5) -> Session:
    """A tracker's readings of so many postures, each so many times."""
    rng = np.random.default_rng(seed)
    once = synthetic.tracked(ARM, synthetic.disturbed(ARM, rng, 0.5), rng, postures)
    seen = once.truth_mm + rng.normal(0.0, ERROR_MM, (postures, 3))
    number = np.arange(postures)
    rows = np.tile(number, times) if in_rounds else np.repeat(number, times)
    copies = once.rows(rows)
    time_s = once.states.time_s[0] + 20.0 * np.arange(len(rows))
    return replace(
        copies,
        states=replace(copies.states, time_s=time_s),
        truth_mm=seen[rows] + rng.normal(0.0, SCATTER_MM, (len(rows), 3)),
        row=np.arange(len(rows)),
    )


def sigma(result: Result) -> np.ndarray:
    return np.sqrt(np.diag(np.array(result.calibration.covariance)))


@pytest.mark.parametrize("in_rounds", [False, True])
def test_copies_claim_no_more_than_postures_read_once(in_rounds: bool) -> None:
    once, thrice = (calibrate([read(60, times, in_rounds)], ARM) for times in (1, 3))
    assert thrice.heldout_by == "posture" and once.heldout_by == "reading"
    assert thrice.heldout.rms_um == pytest.approx(once.heldout.rms_um, rel=0.02)
    known = sigma(once) > 1e-9  # the others move no point
    np.testing.assert_allclose(sigma(thrice)[known], sigma(once)[known], rtol=0.1)
    assert thrice.certificate.granted is once.certificate.granted


def test_copies_are_no_readings_that_a_certificate_asks_for() -> None:
    """15 poses read three times were granted; once each, refused."""
    result = calibrate([read(15, 3)], ARM)
    assert not result.certificate.granted
    assert "45 readings of 15 postures, expected at least 30" in result.certificate.reason


def test_copies_that_share_nothing_count_as_readings() -> None:
    """Where all of the error is a reading's own, three are known √3 times better than one."""
    once, thrice = read(60, 1), read(60, 3)
    rng = np.random.default_rng(8)
    noisy = [
        replace(s, truth_mm=np.repeat(once.truth_mm, t, axis=0) + rng.normal(0.0, 1.0, (60 * t, 3)))
        for s, t in ((once, 1), (thrice, 3))
    ]
    one, three = (sigma(calibrate([session], ARM)) for session in noisy)
    ratio = float(np.median(one[one > 0] / three[one > 0]))
    assert ratio == pytest.approx(np.sqrt(3.0), rel=0.15)

"""Causes that are older than the calibration under test: it has taken up a part of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from armd.compensation.data.session import Session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.identify.calibrate import calibrate
from support import synthetic
from support.planting import Effect, of_joint, planted, wave

ARM = synthetic.arm()
DISC, KNOCK = wave(2, 60.0), of_joint(3, lambda states: np.full(states.n, 30.0))
ECCENTRIC, KNOCKED = ("encoder_eccentricity", "joint 2"), ("geometry_shift", "joint 3")


@dataclass(frozen=True)
class Years:
    """Sessions of one arm by which it was calibrated, and those of a later year."""

    calibrated: list[Session]
    later: list[Session]

    def told(self, before: tuple[Effect, ...], since: tuple[Effect, ...]) -> dict[object, float]:
        """Names and probabilities of what is found under the calibration."""
        calibration = calibrate(planted(self.calibrated, *before), ARM).calibration
        found = diagnose(planted(self.later, *since), ARM, calibration).found
        return {finding.candidate.place: finding.probability for finding in found}


@pytest.fixture(scope="module")
def years() -> Years:
    rng = np.random.default_rng(2)
    truth = synthetic.disturbed(ARM, rng, 0.3)

    def sessions(count: int, first: int) -> list[Session]:
        made = [
            synthetic.session(
                ARM, truth, rng, targets=6, placements=2, readings=60, encoder_rad=4e-6,
                noise_mm=0.004, name=f"session-{first + k}",
            )
            for k in range(count)
        ]  # fmt: skip
        return [
            replace(s, states=replace(s.states, time_s=s.states.time_s + 7200.0 * (first + k)))
            for k, s in enumerate(made)
        ]

    return Years(sessions(4, 0), sessions(5, 10))


def test_a_disc_that_was_off_its_axis_before_is_no_knock(years: Years) -> None:
    """What the constants took up of it looked like knocks of joints 3 and 5, both sure."""
    assert set(years.told((DISC,), (DISC,))) == {ECCENTRIC}


def test_a_knock_since_is_told_beside_an_older_disc(years: Years) -> None:
    told = years.told((DISC,), (DISC, KNOCK))
    assert set(told) == {ECCENTRIC, KNOCKED}
    assert min(told.values()) > 0.95


def test_a_knock_and_a_disc_since_are_both_told(years: Years) -> None:
    told = years.told((), (DISC, KNOCK))
    assert set(told) == {ECCENTRIC, KNOCKED}
    assert min(told.values()) > 0.95

"""Diagnosing under a calibration that a diagnosis wrote, again and again.

An extended calibration carries terms and a covariance: what it knows for sure must not keep the
next diagnosis from finding what changed since. Effects are planted into the angles that were read;
the size found and the gain are judged against what was planted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.extend import extend_calibration
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.fitting.refit import Refits
from armd.compensation.diagnose.heldout.open_constants import add_open_constants
from armd.compensation.diagnose.problem.baseline import from_calibration
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.estimate.linear.bordered import compute_pseudo_inverse_factor
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from armd.simulator.campaigns.hidden import Design
from support.made_case import make_case
from support.planting import ARC_SECOND, Effect, middle_unix_s, planted, rms_um, slip, wave

SINCE_LONG = wave(2, 12.0)  # there before the first diagnosis


@dataclass(frozen=True)
class History:
    """One arm over three times: each is a few sessions; nothing is wrong with it yet."""

    arm: Arm
    first: list[Session]
    second: list[Session]
    third: list[Session]
    holdout: list[Session]
    plain: Calibration  # of the first sessions
    extended: Calibration  # of the first diagnosis, SINCE_LONG found

    @property
    def slip(self) -> Effect:
        return slip(3, 10.0, middle_unix_s(self.second))


@pytest.fixture(scope="module")
def history() -> History:
    made = make_case(601, (), Design(sessions=10, articulations=3, before=6, holdout=2))
    plain, later = made.calibrate_before(), made.sessions
    assert plain is not None
    first = diagnose(planted(made.before, SINCE_LONG), made.arm)
    assert [f.candidate.place for f in first.findings] == [("encoder_eccentricity", "joint 2")]
    return History(made.arm, made.before, later[:5], later[5:], made.holdout, plain, first.extended)


def size_of(diagnosis: Diagnosis, cause: str, location: str) -> tuple[float, float]:
    """Amplitude of the only finding, and its standard uncertainty, arc seconds."""
    assert [f.candidate.place for f in diagnosis.findings] == [(cause, location)]
    values, covariance = diagnosis.search.last.amplitudes[0], diagnosis.search.last.covariances[0]
    size = float(np.linalg.norm(values))
    sigma = float(np.sqrt(values @ covariance @ values)) / size
    return size / ARC_SECOND, sigma / ARC_SECOND


def gains_as_possible(
    history: History,
    diagnosis: Diagnosis,
    calibration: Calibration,
    before: tuple[Effect, ...],
    since: Effect,
) -> None:
    """On sessions that had no part, the extended model takes what the effect did away again."""
    arm, holdout = history.arm, history.holdout
    healthy = rms_um(planted(holdout, *before), arm, calibration)
    sick = rms_um(planted(holdout, *before, since), arm, calibration)
    mended = rms_um(planted(holdout, *before, since), arm, diagnosis.extended)
    assert sick**2 - mended**2 > 0.9 * (sick**2 - healthy**2)
    (gain,) = diagnosis.gains
    assert gain.is_confirmed
    assert gain.before_um**2 - gain.after_um**2 > 0.5 * (sick**2 - healthy**2)


@pytest.mark.slow
def test_the_third_generation_answers_like_the_first(history: History) -> None:
    """The second diagnosis finds a slip, the third, under what the second wrote, an ellipse."""
    arm, ellipse = history.arm, wave(4, 8.0, 2)
    found = diagnose(planted(history.second, SINCE_LONG, history.slip), arm, history.extended)
    size, sigma = size_of(found, "encoder_slip", "joint 3")
    assert size == pytest.approx(10.0, abs=3 * sigma)
    gains_as_possible(history, found, history.extended, (SINCE_LONG,), history.slip)
    third = diagnose(planted(history.third, SINCE_LONG, history.slip, ellipse), arm, found.extended)
    size, sigma = size_of(third, "encoder_ellipticity", "joint 4")
    assert size == pytest.approx(8.0, abs=3 * sigma)
    gains_as_possible(history, third, found.extended, (SINCE_LONG, history.slip), ellipse)


@pytest.mark.slow
def test_an_effect_that_was_not_written_is_no_other_cause_later(history: History) -> None:
    """What the constants took up of it, the next diagnosis may take back: left to hold to them, it
    named an ellipse and a wobble, one of them surely, for what the constants left of the disc."""
    arm, since = history.arm, wave(2, 6.0)
    first = diagnose(planted(history.first, since), arm)
    assert [f.candidate.place for f in first.findings] == [("encoder_eccentricity", "joint 2")]
    last, sessions = first.search.last, first.sessions
    without = Refits(last).with_subset(())
    plain = extend_calibration(without, arm, sessions, left_out=last.findings)
    written = add_open_constants(plain, last, (), arm, sessions)
    assert rms_um(history.holdout, arm, written) == rms_um(history.holdout, arm, plain)
    found = diagnose(planted(history.second, since), arm, written)
    assert [f.candidate.place for f in found.findings] == [("encoder_eccentricity", "joint 2")]


@pytest.mark.slow
def test_a_shifted_length_is_known_no_better_than_its_shift(history: History) -> None:
    """Otherwise the next diagnosis holds to a length that nobody knows so well."""
    given = history.extended
    constants = {**given.constants, "a_3": given.constants["a_3"] + 0.05}
    others = [i for i, name in enumerate(given.covariance_of) if name != "a_3"]
    known = {  # all but the length that will turn out wrong
        "constants": constants,
        "covariance_of": [given.covariance_of[i] for i in others],
        "covariance": [[given.covariance[i][j] for j in others] for i in others],
    }
    under = given.model_copy(update=known)
    found = diagnose(planted(history.second, SINCE_LONG), history.arm, under)
    assert [f.candidate.place for f in found.findings] == [("geometry_shift", "joint 3")]
    at = found.extended.covariance_of.index("a_3")
    sigma = float(np.sqrt(found.extended.covariance[at][at]))
    # The written model is fitted about the length found, the search's about the one given: 1 %.
    searched = float(np.sqrt(found.search.last.covariances[0][0, 0]))
    assert sigma == pytest.approx(searched, rel=0.02)
    assert found.extended.constants["a_3"] - constants["a_3"] == pytest.approx(-0.05, abs=4 * sigma)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "cause", "location", "size"),
    [
        (slip(4, -20.0, 0.0), "geometry_shift", "joint 4", None),
        (wave(3, 8.0), "encoder_eccentricity", "joint 3", 8.0),
        (wave(4, 8.0, 2), "encoder_ellipticity", "joint 4", 8.0),
    ],
)
def test_an_extended_calibration_answers_like_a_plain_one(
    history: History, effect: Effect, cause: str, location: str, size: float | None
) -> None:
    arm = history.arm
    plain = diagnose(planted(history.second, effect), arm, history.plain)
    under = diagnose(planted(history.second, SINCE_LONG, effect), arm, history.extended)
    found, sigma = size_of(under, cause, location)
    assert found == pytest.approx(size_of(plain, cause, location)[0], abs=sigma)
    assert size is None or found == pytest.approx(size, abs=3 * sigma)
    gains_as_possible(history, under, history.extended, (SINCE_LONG,), effect)


def test_what_is_known_for_sure_does_not_hold_the_rest() -> None:
    """One unknown has a prior twenty orders tighter than its rows; the others are free."""
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(50, 4))
    truth = np.array([0.0, 1.0, -2.0, 3.0])
    gram = rows.T @ rows + np.diag([1e24, 0.0, 0.0, 0.0])
    factor = compute_pseudo_inverse_factor(gram)
    assert factor @ (factor.T @ (rows.T @ (rows @ truth))) == pytest.approx(truth, abs=1e-6)


@pytest.mark.slow
def test_what_the_rows_are_silent_about_stays_as_uncertain_as_it_was(history: History) -> None:
    """Readings at the reference temperature tell nothing of the expansion."""
    arm = history.arm
    terms = [Term(parameter="a_2", basis=[Temperature(weights={"t2": 1.0})], coefficient=5e-3)]
    known = {"terms": terms, "covariance_of": ["term 0"], "covariance": [[4e-6]]}
    baseline = from_calibration(history.plain.model_copy(update=known), arm, is_given=True)
    rests = collect_rests(history.second, arm)
    states = rests.observations.states
    reference = np.full_like(states.temperature_c, baseline.model.reference_c)
    states = replace(states, temperature_c=reference)
    rests = replace(rests, observations=replace(rests.observations, states=states))
    found = fit(rests, arm, baseline, baseline.model)
    own = found.layout.identified
    assert baseline.root @ found.inverse[own, own] @ baseline.root.T == pytest.approx(4e-6)

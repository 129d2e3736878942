"""A calibration that left a joint's twist open: the written model bends with it."""

from collections.abc import Sequence

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.extend import extend_calibration
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.fitting.follow import follow_solution
from armd.compensation.diagnose.problem.baseline import from_calibration
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Baseline
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, tie
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.model.terms import Term
from support import synthetic
from support.drawn import drawn

ARM = synthetic.arm(6)
NOISE_MM = 1e-3
#: The tip lies 120 mm from the last joint: so uncertain, its twist moves it by 2.4 mm to first
#: order, and by 24 µm to second.
TWIST_RAD = 0.02
WAVE = Harmonic(kind="sin", joint=2, order=1)
DISC = Candidate(
    "encoder_eccentricity",
    location.joint(2),
    (Column("sin", "rad", 3e-5, tie([("theta_2", 1.0)], WAVE)),),
    ("q2",),
)


def given() -> Calibration:
    covariance = np.diag(np.square([TWIST_RAD, 2e-3, 2e-3])).tolist()
    return drawn(ARM, covariance_of=["alpha_6", "tip_y", "tip_z"], covariance=covariance)


def measured(twist: float, rng: np.random.Generator, name: str) -> Session:
    constants = ARM.nominal()
    constants[ARM.layout.index("alpha_6")] += twist
    disc = Term(parameter="theta_2", basis=[WAVE], coefficient=1e-4)
    return synthetic.session(ARM, constants, rng, terms=[disc], noise_mm=NOISE_MM, name=name)


def fitted(baseline: Baseline, sessions: Sequence[Session], findings: list[Candidate]) -> Fit:
    start = [np.zeros(len(c.columns)) for c in findings]
    return fit(collect_rests(sessions, ARM), ARM, baseline, baseline.model, findings, start)


def rms_um(sessions: Sequence[Session], model: Calibration) -> float:
    return float(np.sqrt((evaluate(sessions, ARM, model).distance_um ** 2).mean()))


def test_a_long_step_is_followed_where_the_model_bends() -> None:
    rng = np.random.default_rng(1)
    own, other = (measured(TWIST_RAD, rng, name) for name in ("own", "other"))
    baseline = from_calibration(given(), ARM, is_given=True)
    linear = fitted(baseline, [own], [DISC])
    bent = follow_solution(linear, ARM)
    noise_um = 1e3 * NOISE_MM * np.sqrt(3.0)
    assert rms_um([other], extend_calibration(linear, ARM, [own])) > 5.0 * noise_um
    assert rms_um([other], extend_calibration(bent, ARM, [own])) < 1.1 * noise_um
    assert abs(bent.amplitudes[0][0] - 1e-4) < 4.0 * np.sqrt(bent.covariances[0][0, 0])


@pytest.mark.parametrize("twist", [-5e-3, 0.025, 0.05])
def test_what_is_written_is_never_worse_than_what_was_given(twist: float) -> None:
    """Along the valley in which the twist and the tip's offset make up for each other, whole steps
    go to and fro: each is taken as far as it helps."""
    rng = np.random.default_rng(4)
    own, other = (measured(twist, rng, name) for name in ("own", "other"))
    baseline = from_calibration(given(), ARM, is_given=True)
    bent = follow_solution(fitted(baseline, [own], [DISC]), ARM)
    written = extend_calibration(bent, ARM, [own])
    assert rms_um([own], written) < rms_um([own], baseline.calibration)
    assert rms_um([other], written) < 1.1 * 1e3 * NOISE_MM * np.sqrt(3.0)


def test_where_the_linear_answer_holds_it_stays() -> None:
    own = measured(1e-5, np.random.default_rng(2), "own")
    baseline = from_calibration(given(), ARM, is_given=True)
    linear = fitted(baseline, [own], [DISC])
    bent = follow_solution(linear, ARM)
    sigma = np.sqrt(np.diag(linear.inverse))[linear.layout.identified]
    change = (bent.solution - linear.solution)[linear.layout.identified]
    assert np.abs(change / sigma).max() < 0.1
    assert follow_solution(fitted(baseline, [own], []), ARM).findings == ()


def test_constants_that_were_moved_already_stay() -> None:
    own = measured(TWIST_RAD, np.random.default_rng(3), "own")
    baseline = from_calibration(given(), ARM, is_given=False)
    found = fitted(baseline, [own], [DISC])
    assert follow_solution(found, ARM) is found

"""The model under test: a given calibration, or one that `armd calibrate` makes of the sessions."""

from __future__ import annotations

from collections.abc import Sequence

from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.fitting.free_expansion import open_growth
from armd.compensation.diagnose.problem.baseline import from_calibration, keep_size
from armd.compensation.diagnose.problem.linear import Baseline
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.identify.admission.inconsistent_session import (
    InconsistentSession,
    fit_and_find_inconsistent_session,
)
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration


def make_model_and_judge_sessions(
    sessions: Sequence[Session], arm: Arm, calibration: Calibration | None
) -> tuple[Baseline, InconsistentSession | None]:
    """Return the model under test, and the session that is inconsistent with the others.

    The model is the given calibration, or what `armd calibrate` makes of the sessions. The plain
    linear thermal model is used wherever there can be one. By itself `armd calibrate` chooses a
    thermal model by its error. A flexible one would absorb causes that have a name (a link's
    nonlinear expansion, a joint that turns with temperature). Beside a strong error it chooses
    none, so that plain expansion would be reported.
    """
    if calibration is None:
        result = calibrate(sessions, arm, Options(compare=False))
        baseline = from_calibration(result.calibration, arm, False, result.reflectors)
        return baseline, result.inconsistent_session
    baseline, observations = _fix_calibration(sessions, arm, calibration)
    if has_reflectors(sessions):  # the tip of each reading is unknown
        return baseline, None
    return baseline, fit_and_find_inconsistent_session(sessions, observations)


def _fix_calibration(
    sessions: Sequence[Session], arm: Arm, calibration: Calibration
) -> tuple[Baseline, Observations]:
    """Return a given calibration as the model under test, and the observations of *sessions*."""
    observations = collect_observations(sessions, arm, calibration.artefact)
    sits = evaluate(sessions, arm, calibration).reflectors if has_reflectors(sessions) else ()
    baseline = open_growth(from_calibration(calibration, arm, True, sits), arm)
    if observations.on_surface.any() and not _knows_scale(observations):
        baseline = keep_size(baseline, arm)
    return baseline, observations


def has_reflectors(sessions: Sequence[Session]) -> bool:
    """Return whether readings are of reflectors, not of the tip."""
    return any(session.reflector is not None for session in sessions)


def _knows_scale(observations: Observations) -> bool:
    """Return whether a certified size or position determines how large the arm is."""
    lengths = len(observations.distances.length_mm) > 0
    return lengths or bool(observations.has_truth.any() or observations.says_size.any())

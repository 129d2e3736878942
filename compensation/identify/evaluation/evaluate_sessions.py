"""Evaluate sessions in memory for `armd evaluate`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from threadpoolctl import threadpool_limits

from armd.compensation.data.sessions.points_only import require_points
from armd.compensation.data.sessions.session import Session
from armd.compensation.identify.evaluation.evaluate import Evaluation, evaluate
from armd.compensation.identify.evaluation.outside_range import OutsideRange
from armd.compensation.identify.evaluation.seated_again import fit_tip, make_tip_hint, replace_tip
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.progress import TellStep


def evaluate_sessions(
    sessions: Sequence[Session],
    arm: Arm,
    calibration: Calibration | None,
    progress: TellStep,
    *,
    refit_tip: bool = False,
) -> tuple[dict[str, Any], Evaluation]:
    """Evaluate sessions in memory; return the object of `--json`, and the residuals."""
    with threadpool_limits(limits=1, user_api="blas"):
        return _evaluate_sessions(sessions, arm, calibration, progress, refit_tip)


def _evaluate_sessions(
    sessions: Sequence[Session],
    arm: Arm,
    calibration: Calibration | None,
    progress: TellStep,
    refit_tip: bool,
) -> tuple[dict[str, Any], Evaluation]:
    outside = OutsideRange(arm, calibration)
    for i, session in enumerate(sessions):
        outside.add(i, session.name, session.states.temperature_c)
    remarks = [remark for session in sessions for remark in session.remarks]
    remarks += outside.in_words()
    if any(session.turn is not None for session in sessions):
        remarks.append("orientations take no part in these figures: `armd calibrate` uses them")
    extra: dict[str, Any] = {}
    if refit_tip:
        require_points(sessions, "`armd evaluate --fit-tip`")
        tip = fit_tip(sessions, arm, calibration)
        extra["tip"] = tip.as_json()
        remarks.append(f"tip fitted anew: {tip.in_words()}")
        arm, calibration = replace_tip(arm, calibration, tip)
    evaluation = evaluate(sessions, arm, calibration, progress)
    if not refit_tip and not evaluation.reflectors:
        remarks += make_tip_hint(arm, calibration, evaluation)
    return {**evaluation.as_json(), **extra, "remarks": remarks}, evaluation

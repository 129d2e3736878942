"""Fit the tip again, where a ball or reflector was exchanged or seated differently."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from armd.arrays import F64
from armd.compensation.data.sessions.session import Session
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.evaluation.evaluate import Evaluation, evaluate
from armd.compensation.identify.fit import fit
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.parameters import TIP_PARAMETERS
from armd.errors import BadInput

#: A fitted tip is worth a hint if it leaves less than this share of the error …
EXPLAINS = 0.5
#: … and moves by more than this: a seat repeats to less.
LEAST_MOVED_MM = 0.02
#: A trial move of the tip: large beside rounding, small beside a placement's lever.
TRIAL_MM = 0.1
#: Directions in which a tip moves the residuals by less than this share of the best known one are
#: not fitted: the placements absorb them.
LEAST_SINGULAR = 1e-3
#: The least readings for three more unknowns.
LEAST_READINGS = 12
#: With more readings, no fit is made for a hint.
MOST_READINGS = 5_000


@dataclass(frozen=True)
class FittedTip:
    """The tip's offset as fitted to these sessions."""

    offset_mm: F64  # (3,) last frame
    standard_uncertainty_mm: F64  # (3,)
    before_mm: F64  # (3,) of the evaluated model

    @property
    def moved_mm(self) -> float:
        """The distance from the model's tip."""
        return float(np.linalg.norm(self.offset_mm - self.before_mm))

    def as_json(self) -> dict[str, Any]:
        return {
            "offset_mm": self.offset_mm.tolist(),
            "standard_uncertainty_mm": self.standard_uncertainty_mm.tolist(),
            "before_mm": self.before_mm.tolist(),
        }

    def in_words(self) -> str:
        x, y, z = (f"{mm:.3f}" for mm in self.offset_mm)
        return f"({x}, {y}, {z}) mm in the last frame, {self.moved_mm:.3f} mm from before"


def fit_tip(sessions: Sequence[Session], arm: Arm, calibration: Calibration | None) -> FittedTip:
    """Fit one tip to all *sessions*, with all other parameters of the model fixed.

    Raises `BadInput` for fewer than `LEAST_READINGS` readings.
    """
    observations = evaluate(sessions, arm, calibration).observations
    constants = calibration.vector(arm.n_joints) if calibration else arm.nominal()
    terms = calibration.terms if calibration else []
    reference_c = (calibration or arm).reference_temperature_c
    unknowns = Unknowns(TIP_PARAMETERS)
    if observations.n < LEAST_READINGS:
        expected = f"{LEAST_READINGS} at least, to fit the tip"
        raise BadInput(sessions[0].path, "readings", f"{observations.n}", expected)
    with threadpool_limits(limits=1, user_api="blas"):  # small matrices: threads only cost
        identification = fit(observations, constants, terms, unknowns, reference_c)
    tip_slice = arm.layout.tip
    scale = np.sqrt(np.maximum(np.diag(identification.covariance)[:3], 0.0))
    return FittedTip(identification.constants[tip_slice], scale, constants[tip_slice])


def make_tip_hint(arm: Arm, calibration: Calibration | None, evaluation: Evaluation) -> list[str]:
    """Return a sentence where another tip would explain most of the residuals.

    One linear step is made, without a fit, so a hint costs no more than the evaluation itself.
    Without a calibration no hint is given, because the nominal geometry misses by more than its
    tip.
    """
    if calibration is None or not LEAST_READINGS <= evaluation.observations.n <= MOST_READINGS:
        return []
    if evaluation.rms_um < 1e3 * LEAST_MOVED_MM:
        return []
    with threadpool_limits(limits=1, user_api="blas"):
        step_mm, rms_um = _compute_tip_step(calibration.vector(arm.n_joints), evaluation)
    moved_mm = float(np.linalg.norm(step_mm))
    if moved_mm < LEAST_MOVED_MM or rms_um > EXPLAINS * evaluation.rms_um:
        return []
    return [
        f"with the tip moved by {moved_mm:.3f} mm the residuals are {rms_um:.4g} instead of"
        f" {evaluation.rms_um:.4g} µm RMS. Was the ball or reflector changed or seated again?"
        " --fit-tip fits it and evaluates so."
    ]


def _compute_tip_step(constants: F64, evaluation: Evaluation) -> tuple[F64, float]:
    """Return the tip's move (3,) mm that lowers the residuals most, and their RMS (µm) there.

    Placements and unknown seats follow each trial move (variable projection). The last frame is
    turned as by the *constants* (P,) alone: terms turn it by less than a milliradian.
    """
    observations = evaluation.observations
    last_frame = compute_pose(observations.states.q, constants)[1]

    def residual(step_mm: F64) -> F64:
        position: F64 = evaluation.position_mm + last_frame @ step_mm
        return fit_poses(observations, position).residual(observations, position)

    columns = [
        (residual(TRIAL_MM * axis) - evaluation.residual_mm).ravel() / TRIAL_MM
        for axis in np.eye(3)
    ]
    stacked = np.stack(columns, axis=1)
    solved = np.linalg.lstsq(stacked, -evaluation.residual_mm.ravel(), rcond=LEAST_SINGULAR)
    step_mm = np.asarray(solved[0], dtype=np.float64)
    squares = (residual(step_mm) ** 2).sum(axis=1)
    return step_mm, 1e3 * float(np.sqrt(squares.mean()))


def replace_tip(
    arm: Arm, calibration: Calibration | None, tip: FittedTip
) -> tuple[Arm, Calibration | None]:
    """Return the arm and the calibration with the fitted tip."""
    offset = [float(mm) for mm in tip.offset_mm]
    if calibration is None:
        fitted_tip = arm.tip.model_copy(update={"offset_mm": offset})
        return arm.model_copy(update={"tip": fitted_tip}), None
    constants = {**calibration.constants, **dict(zip(TIP_PARAMETERS, offset, strict=True))}
    return arm, calibration.model_copy(update={"constants": constants})

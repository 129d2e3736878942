"""Calibrate a tip from a session: offset, radius, uncertainty, form, and a verdict."""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from armd import POINT
from armd.arrays import F64
from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.identify.tip import TipFit, fit_in_seat, fit_on_sphere
from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import LoadedCalibration, load_calibration
from armd.daemon.files.tip_history import GOOD
from armd.daemon.measure.in_use import ARM, CALIBRATION
from armd.daemon.measure.log import load_beginning
from armd.errors import BadInput

#: The calibration's own tip, as `armd tip use -` selects it.
OWN = "-"


@dataclass(frozen=True)
class TipCalibration:
    """The result of `armd tip calibrate`; lengths in mm."""

    serial: str
    name: str
    fit: TipFit
    before_mm: F64  # (3,) the offset that was in use
    started_unix_s: float
    session: Path
    calibration: str | None  # SHA-256 of the active file
    doubts: tuple[str, ...]  # empty: the verdict is good

    @property
    def verdict(self) -> str:
        return GOOD if not self.doubts else "doubtful: " + "; ".join(self.doubts)

    def as_json(self) -> dict[str, Any]:
        measured = datetime.datetime.fromtimestamp(self.started_unix_s, datetime.UTC)
        return {
            "name": self.name,
            "serial": self.serial,
            "measured": measured.isoformat(timespec="seconds"),
            **self.fit.as_json(),
            "before_mm": self.before_mm.tolist(),
            "verdict": self.verdict,
            "session": str(self.session.resolve()),
            "calibration": self.calibration,
        }


def calibrate_tip(
    folder: Path, name: str | None, sphere_mm: float | None, limit_mm: float, form_mm: float
) -> TipCalibration:
    """Calibrate a tip from the session that `armd measure tip` wrote into *folder*.

    The offset's expanded uncertainty (k = 2) must be within *limit_mm*, the form error within
    *form_mm*. Raises `BadInput` for a session that does not determine the offset.
    """
    header = load_beginning(folder) or {}
    plan = header.get("plan")
    plan_sphere_mm = plan.get("sphere_mm") if isinstance(plan, dict) else None
    sphere_mm = plan_sphere_mm if sphere_mm is None else sphere_mm
    if not (folder / ARM).exists():
        expected = f"a session of `armd measure tip`, with {ARM} in it"
        raise BadInput(folder, ARM, "nothing", expected)
    arm = load_arm(folder / ARM)
    path = folder / CALIBRATION
    calibration = load_calibration(path, arm) if path.exists() else None
    session = load_session(folder, arm)
    origin, rotation, offset = _collect_frames(session, arm, calibration)
    if not np.isfinite(origin).all():
        row = int(np.flatnonzero(~np.isfinite(origin).all(axis=1))[0])
        raise BadInput(folder / "readings.csv", f"row {row + 1}", "no point", "a temperature")
    try:
        if sphere_mm is None:
            fit = fit_in_seat(origin, rotation)
        else:
            fit = fit_on_sphere(origin, rotation, offset, sphere_mm)
    except ArithmeticError as error:
        raise BadInput(folder, "readings", str(error), "readings that tell the offset") from error
    selected = header.get("tip")
    return TipCalibration(
        serial=arm.serial_number,
        name=name or (selected if isinstance(selected, str) else OWN),
        fit=fit,
        before_mm=offset,
        started_unix_s=session.started_unix_s,
        session=folder,
        calibration=None if calibration is None else calibration.sha256,
        doubts=tuple(_list_doubts(fit, limit_mm, form_mm)),
    )


def _collect_frames(
    session: Session, arm: Arm, calibration: LoadedCalibration | None
) -> tuple[F64, F64, F64]:
    """Return origins (n, 3) and rotations (n, 3, 3) of the last frame.

    Also returns the tip's offset (3,) in use. A reading without a temperature has NaN.
    """
    model, states = Model(arm, calibration), session.states
    points = np.zeros(session.n, POINT)
    for i in np.argsort(states.time_s, kind="stable"):
        row = slice(int(i), int(i) + 1)
        model.fold(states.temperature_c[i], float(states.time_s[i]))
        model.correct(states.q[row], states.rate[row], states.approach[row], points[row])
    offset = np.array(model.constants[arm.layout.tip])
    position = np.array(points["position_mm"])
    is_known = np.isfinite(position).all(axis=1)
    rotation = np.full((session.n, 3, 3), np.nan)
    rotation[is_known] = Rotation.from_quat(points["orientation"][is_known]).as_matrix()
    return position - rotation @ offset, rotation, offset


def _list_doubts(fit: TipFit, limit_mm: float, form_mm: float) -> list[str]:
    doubts = []
    expanded = 2 * float(fit.uncertainty_mm.max())
    if expanded > limit_mm:
        axis = "xyz"[int(np.argmax(fit.uncertainty_mm))]
        text = f"the offset's {axis} is known within {expanded:.3f} mm (k = 2) alone"
        doubts.append(f"{text}, expected {limit_mm:g} mm: more readings, in postures less alike")
    if fit.form_error_mm > form_mm:
        problem = f"the readings lie within {fit.form_error_mm:.3f} mm of each other's place"
        doubts.append(f"{problem}, expected {form_mm:g} mm: a loose tip or seat, or the arm itself")
    if fit.radius_mm is not None and fit.radius_mm <= 0:
        problem = f"the ball's radius comes out as {fit.radius_mm:.3f} mm"
        doubts.append(f"{problem}: another sphere, or touched from inside?")
    return doubts


def measure_moved_mm(
    calibration: TipCalibration, last: dict[str, Any] | None
) -> tuple[float, float, str]:
    """Return the offset's shift, its expanded uncertainty (k = 2), and since when.

    The shift is from the last calibration of this tip, else from the offset in use.
    """
    variance = float(np.trace(calibration.fit.covariance_mm2))
    before, since = calibration.before_mm, "what was in use"
    if last is not None:
        before = np.array(last["offset_mm"], dtype=float)
        variance += float(np.trace(np.array(last["covariance_mm2"], dtype=float)))
        since = str(last["measured"])
    distance = float(np.linalg.norm(calibration.fit.offset_mm - before))
    return distance, 2 * math.sqrt(variance), since

"""`evaluate`: residuals of sessions under a model."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from armd.arrays import I64
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.identify.evaluation.evaluate import Evaluation
from armd.compensation.identify.evaluation.evaluate import evaluate as evaluate_loaded
from armd.compensation.identify.evaluation.evaluate_files import evaluate_files, is_long
from armd.compensation.identify.evaluation.evaluate_sessions import evaluate_sessions
from armd.compensation.identify.evaluation.lengths import Length
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.progress import TellStep
from armd.offline.arm_model import ArmModel, PathText, resolve_arm
from armd.offline.calibration import Calibration, resolve_calibration
from armd.offline.inputs.session import Session, Sessions, load_sessions, resolve_sessions
from armd.offline.results.arrow_table import ArrowTable
from armd.offline.results.display import Displayed, Facts


class EvaluationResult(Displayed):
    """Residuals of readings under a model; `evaluate` makes it."""

    def __init__(
        self,
        figures: dict[str, Any],
        lengths: list[Length],
        evaluation: Evaluation | None,
        inputs: tuple[list[Session], ArmModel, LoadedCalibration | None],
    ) -> None:
        self._figures = figures
        self._evaluation = evaluation
        self._inputs = inputs
        #: certified lengths and those measured; not public
        self.lengths = lengths

    @property
    def rms_um(self) -> float:
        """The 3-D RMS in µm over all readings that could be evaluated."""
        return float(self._figures["rms_um"])

    @property
    def max_um(self) -> float:
        """The largest 3-D residual in µm."""
        return float(self._figures["max_um"])

    @property
    def n(self) -> int:
        """The number of readings that could be evaluated."""
        return int(self._figures["n"])

    @cached_property
    def residuals(self) -> ArrowTable:
        """A table with one row for each reading.

        Its columns are `session, row, placement, target, dx_um, dy_um, dz_um, residual_um`. `row`
        counts from 1 within the session's table. `dx_um` … are tip minus target in the base frame,
        `residual_um` their length; all missing where a reading lacks a temperature that the
        calibration needs. Sessions too long for memory were evaluated piece by piece; this reads
        them whole.
        """
        sessions, arm, calibration = self._inputs
        loaded, _ = load_sessions(sessions, arm.content)
        content = calibration.content if calibration else None
        evaluation = self._evaluation or evaluate_loaded(loaded, arm.content, content)
        every = collect_observations(loaded, arm.content, content.artefact if content else None)
        residual_um = np.full((every.n, 3), np.nan)
        residual_um[_places(every, evaluation.observations)] = 1e3 * evaluation.residual_mm
        length_um = np.full(every.n, np.nan)
        length_um[_places(every, evaluation.observations)] = evaluation.distance_um
        names = np.array(every.session_names)
        return ArrowTable(
            {
                "session": names[every.session],
                "row": every.row + 1,
                "placement": _strip(every.placement_names, names[every.placement_session])[
                    every.placement
                ],
                "target": _strip(every.target_names, names[every.target_session])[every.target],
                "dx_um": residual_um[:, 0],
                "dy_um": residual_um[:, 1],
                "dz_um": residual_um[:, 2],
                "residual_um": length_um,
            }
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the output of `armd evaluate --json`."""
        return dict(self._figures)

    def _describe(self) -> tuple[str, Facts]:
        figures = self._figures
        facts = [
            ("3-D RMS", f"{self.rms_um:.2f} µm"),
            ("median", f"{figures['median_um']:.2f} µm"),
            ("maximum", f"{self.max_um:.2f} µm"),
            ("readings", f"{self.n}, {figures['n_unused']} without a temperature"),
        ]
        facts += [
            (f"session {name}", f"{figure['rms_um']:.2f} µm, {figure['n']} readings")
            for name, figure in figures["by_session"].items()
            if figure["n"]
        ]
        facts += [("remark", remark) for remark in figures["remarks"]]
        return "Evaluation", facts


def evaluate(
    sessions: Sessions,
    arm: ArmModel | PathText,
    calibration: Calibration | PathText | None = None,
    *,
    fit_tip: bool = False,
    progress: TellStep = lambda _text: None,
) -> EvaluationResult:
    """Evaluate sessions under a calibration: `armd evaluate`.

    Only placements and unknown seats are fitted. *sessions*: a `Session`, the path of a session's
    folder, or several of them. *calibration*: None means the nominal geometry of *arm*. *fit_tip*:
    fit the tip to these sessions first. *progress* is called with each step.

    Raises `armd.BadInput` where a file is invalid or no reading can be evaluated.

    >>> result = armd.evaluate("measured/T20", "measured/arm.toml", "calibration.json")
    >>> len(result.residuals) == result.n
    True
    """
    model = resolve_arm(arm)
    loaded_calibration = resolve_calibration(calibration, model)
    content = loaded_calibration.content if loaded_calibration else None
    listed = resolve_sessions(sessions)
    folders = [str(session.path) for session in listed if session.path is not None]
    if len(folders) == len(listed) and not fit_tip and is_long(folders):
        figures, lengths = evaluate_files(folders, model.content, content, progress)
        return EvaluationResult(figures, lengths, None, (listed, model, loaded_calibration))
    loaded, _ = load_sessions(listed, model.content)
    figures, evaluation = evaluate_sessions(
        loaded, model.content, content, progress, refit_tip=fit_tip
    )
    return EvaluationResult(
        figures, evaluation.lengths, evaluation, (listed, model, loaded_calibration)
    )


def _places(every: Observations, part: Observations) -> I64:
    """Return the indices of the readings of *part* among *every* one."""
    n_rows = int(every.row.max()) + 1
    key, part_key = every.session * n_rows + every.row, part.session * n_rows + part.row
    order = np.argsort(key, kind="stable")
    places: I64 = order[np.searchsorted(key, part_key, sorter=order)]
    return places


def _strip(names: list[str], sessions: Any) -> Any:
    """Return names without the session's name before them."""
    pairs = zip(names, sessions, strict=True)
    return np.array([name.removeprefix(f"{session}/") for name, session in pairs])

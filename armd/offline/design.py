"""`design`: the poses to measure next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from armd.compensation.data.sessions.points_only import require_points
from armd.compensation.data.sessions.session import Session as StoredSession
from armd.compensation.design.conditions import POOL
from armd.compensation.design.design import Experiment
from armd.compensation.design.design import design as choose
from armd.compensation.diagnose.diagnose import diagnose as diagnose_loaded
from armd.compensation.diagnose.report.advice import propose_experiment
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.progress import TellShare
from armd.errors import BadInput
from armd.offline.arm_model import ArmModel, PathText, resolve_arm
from armd.offline.calibration import Calibration, resolve_calibration
from armd.offline.first_design import FirstDesignResult, design_without_sessions
from armd.offline.inputs.session import Sessions, load_sessions, resolve_sessions
from armd.offline.results.arrow_table import ArrowTable
from armd.offline.results.display import Facts, Reported

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class DesignResult(Reported):
    """Poses to measure next, and their expected benefit; `design` makes it."""

    def __init__(
        self,
        experiment: Experiment,
        sentence: str,
        sessions: list[StoredSession],
        arm: ArmModel,
        calibration: LoadedCalibration | None,
    ) -> None:
        #: the experiment in the form of armd's own functions; not public
        self.experiment = experiment
        #: the given sessions, in the same form; not public
        self.sessions = sessions
        #: the advice of a diagnosis of the sessions, in one sentence
        self.next_experiment = sentence
        self._arm = arm
        self._calibration = calibration
        #: one dict for each pose, with the table's columns
        self.rows = _rows(experiment, arm.sensors)

    @property
    def poses(self) -> ArrowTable:
        """A table with one row for each pose.

        Its columns are `pose`, the tip `x_mm, y_mm, z_mm`, `q1_deg` …, the side of approach of each
        joint (`+`, `-`), and a column in °C for each sensor.
        """
        return ArrowTable({name: [row[name] for row in self.rows] for name in self.rows[0]})

    def to_dict(self) -> dict[str, Any]:
        """Return the output of `armd design --json`."""
        experiment = self.experiment
        return {
            "schema": "armd.design/1",
            "goal": experiment.criterion.words,
            "quantity": experiment.criterion.quantity,
            "unit": experiment.criterion.unit,
            "before": experiment.before,
            "after": experiment.after,
            "climate": experiment.climate.words,
            "next_experiment": self.next_experiment,
            "poses": self.rows,
        }

    def plot(self, *, ax: Axes | None = None) -> Figure:
        """Draw the arm in each pose, from above and from the side; return the matplotlib figure.

        *ax*: axes for the side view, or for a view in space if they have three dimensions.
        """
        from armd.compensation.report.design import draw_poses

        experiment = self.experiment
        return draw_poses(experiment.states.q, experiment.tip_mm, experiment.parameters, ax)

    def page(self) -> str:
        """Return the report. Not public."""
        from armd.compensation.report.design import make_design_report
        from armd.offline.results.pages import list_inputs

        files = list_inputs(self._arm, self._calibration)
        return make_design_report(
            self.experiment, self._arm.content, self.sessions, self.rows, files
        )

    def _describe(self) -> tuple[str, Facts]:
        experiment = self.experiment
        unit = experiment.criterion.unit
        facts = [
            ("goal", experiment.criterion.words),
            ("conditions", experiment.climate.words),
            ("poses", str(len(self.rows))),
            (
                experiment.criterion.quantity,
                f"{experiment.before:.2f} → {experiment.after:.2f} {unit}",
            ),
            ("diagnosis", self.next_experiment),
        ]
        return f"Next experiment with arm {self._arm.serial_number}", facts


@overload
def design(
    arm: ArmModel | PathText,
    sessions: None = None,
    *,
    calibration: Calibration | PathText | None = None,
    readings: int | None = None,
    artefact: Mapping[str, Any] | PathText | None = None,
    progress: TellShare = ...,
) -> FirstDesignResult: ...
@overload
def design(
    arm: ArmModel | PathText,
    sessions: Sessions,
    *,
    calibration: Calibration | PathText | None = None,
    readings: int | None = None,
    artefact: Mapping[str, Any] | PathText | None = None,
    progress: TellShare = ...,
) -> DesignResult: ...
def design(
    arm: ArmModel | PathText,
    sessions: Sessions | None = None,
    *,
    calibration: Calibration | PathText | None = None,
    readings: int | None = None,
    artefact: Mapping[str, Any] | PathText | None = None,
    progress: TellShare = lambda _text, _share: None,
) -> DesignResult | FirstDesignResult:
    """Choose the poses to measure next: `armd design`.

    *sessions*: those measured so far; None: poses for a first calibration. In these, a tracker
    measures the tip, or the tip touches the targets of *artefact* (a dict as `[artefact]` of
    session.toml, or a file that has one). *calibration*: the model under test; None: that of
    `calibrate` for these sessions, or arm.toml. *readings*: the number of poses; None: with
    sessions 12, up to 24 where causes are close; without, as many as a certificate requires.
    *progress* is called with each step and the share that is done.

    Raises `armd.BadInput` where the sessions cannot be used, or no such poses are found.

    >>> len(armd.design("sick/arm.toml", "sick/session-1", readings=5).poses)
    5
    """
    model = resolve_arm(arm)
    if sessions is None:
        loaded = resolve_calibration(calibration, model)
        return design_without_sessions(model, loaded, readings, artefact)
    check_readings(readings)
    if artefact is not None:
        raise BadInput("artefact", "value", "it with sessions", "it without: theirs is known")
    loaded = resolve_calibration(calibration, model)
    content = loaded.content if loaded else None
    read, _ = load_sessions(resolve_sessions(sessions), model.content)
    require_points(read, "`armd design`")
    diagnosis = diagnose_loaded(read, model.content, content, progress=progress)
    progress("choosing poses", 1.0)
    experiment = choose(diagnosis, readings)
    return DesignResult(experiment, propose_experiment(diagnosis), read, model, loaded)


def check_readings(readings: int | None) -> None:
    """Raise `BadInput` for a number of poses that cannot be chosen."""
    if readings is not None and not 1 <= readings <= POOL:
        raise BadInput("--readings/--poses", "value", str(readings), f"1 to {POOL}")


def _rows(experiment: Experiment, sensors: list[str]) -> list[dict[str, Any]]:
    """Make one row per pose: tip, joint angles, sides of approach, temperatures."""
    states = experiment.states
    return [
        {
            "pose": i + 1,
            **{f"{a}_mm": round(float(v), 1) for a, v in zip("xyz", tip, strict=True)},
            **{f"q{k}_deg": round(float(v), 1) for k, v in enumerate(np.degrees(states.q[i]), 1)},
            **{
                f"approach_joint_{k}": "+" if v > 0 else "-"
                for k, v in enumerate(states.rate[i], 1)
            },
            **{
                f"{name}_c": round(float(v), 1)
                for name, v in zip(sensors, states.temperature_c[i], strict=True)
            },
        }
        for i, tip in enumerate(experiment.tip_mm)
    ]

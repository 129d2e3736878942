"""Poses before the first measurement: the result of `design` without sessions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from armd.compensation.data.sessions.format import Artefact, ArtefactFile
from armd.compensation.data.sessions.points_only import refuse_surfaces
from armd.compensation.design.first import Bounds, FirstExperiment, design_first
from armd.compensation.model.calibration import LoadedCalibration
from armd.files.schema import validate
from armd.offline.arm_model import ArmModel, PathText
from armd.offline.inputs.session import to_artefact_content
from armd.offline.results.arrow_table import ArrowTable
from armd.offline.results.display import Facts, Reported
from armd.terminal.counted import format_count

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class FirstDesignResult(Reported):
    """Poses for a first calibration, and their expected quality; `design` makes it."""

    def __init__(
        self,
        experiment: FirstExperiment,
        arm: ArmModel,
        calibration: LoadedCalibration | None,
        artefact: Artefact | None,
    ) -> None:
        #: the experiment in the form of armd's own functions; not public
        self.experiment = experiment
        self._arm = arm
        self._calibration = calibration
        self._artefact = artefact
        #: one dict for each pose, with the table's columns
        self.rows = _rows(experiment)
        #: sentences on the quality of the poses
        self.words = _in_words(experiment)

    @property
    def poses(self) -> ArrowTable:
        """A table with one row for each pose.

        Its columns are `pose`, with an artefact `placement` and `target`, the tip `x_mm, y_mm,
        z_mm`, `q1_deg` …, and `q1` … in rad.
        """
        return ArrowTable({name: [row[name] for row in self.rows] for name in self.rows[0]})

    @property
    def rank(self) -> int:
        """The number of directions of the constants that the poses determine."""
        return self.experiment.rank

    @property
    def structural_rank(self) -> int:
        """The number of directions that move a point at all."""
        return self.experiment.structural_rank

    @property
    def observability(self) -> dict[str, float]:
        """The indices `O1` … `O5` (Sun and Hollerbach 2008)."""
        return self.experiment.observability

    @property
    def condition_number(self) -> float | None:
        """The condition number of the scaled Jacobian; None where a direction is not determined."""
        return self.experiment.condition_number

    def to_dict(self) -> dict[str, Any]:
        """Return the output of `armd design --json`."""
        experiment = self.experiment
        return {
            "schema": "armd.design/1",
            "goal": "determine the constants of the arm",
            "target_kind": "artefact" if experiment.placements else "tracker",
            "readings": len(self.rows),
            "certificate_readings": experiment.certificate,
            "constants": experiment.constants,
            "rank": experiment.rank,
            "structural_rank": experiment.structural_rank,
            "observability": experiment.observability,
            "condition_number": experiment.condition_number,
            "singular_values_mm": experiment.singular_values.tolist(),
            "noise_mm": experiment.noise_mm,
            "not_known": experiment.not_known,
            "below_base": experiment.below_base,
            "poses": self.rows,
        }

    def plot(self, *, ax: Axes | None = None) -> Figure:
        """Draw the arm in each pose, from above and from the side; return the matplotlib figure.

        *ax*: axes for the side view, or for a view in space if they have three dimensions.
        """
        from armd.compensation.report.design import draw_poses

        experiment = self.experiment
        return draw_poses(experiment.q, experiment.tip_mm, experiment.parameters, ax)

    def page(self) -> str:
        """Return the report. Not public."""
        from armd.compensation.report.first_design import make_first_design_report
        from armd.offline.results.pages import hash_data, list_inputs

        files = list_inputs(self._arm, self._calibration)
        if self._artefact is not None:
            content = self._artefact.model_dump(mode="json", by_alias=True, exclude_defaults=True)
            files["artefact"] = hash_data(self._artefact.name, content)
        rows_in_degrees = [{k: v for k, v in row.items() if not _is_rad(k)} for row in self.rows]
        return make_first_design_report(
            self.experiment, self._arm.content, rows_in_degrees, self.words, files
        )

    def _describe(self) -> tuple[str, Facts]:
        experiment = self.experiment
        condition = experiment.condition_number
        facts = [
            ("poses", str(len(self.rows))),
            ("rank", f"{experiment.rank} of {experiment.structural_rank}"),
            ("condition number", "infinite" if condition is None else f"{condition:.3g}"),
            *(("not known", unknown_quantity) for unknown_quantity in experiment.not_known),
        ]
        return f"First experiment with arm {self._arm.serial_number}", facts


def design_without_sessions(
    arm: ArmModel,
    calibration: LoadedCalibration | None,
    readings: int | None,
    artefact: Mapping[str, Any] | PathText | None,
    bounds: Bounds | None = None,
) -> FirstDesignResult:
    """Return poses for a first calibration; raises `BadInput` where there are none. Not public."""
    content = arm.content
    parameters = (
        content.nominal() if calibration is None else calibration.content.vector(content.n_joints)
    )
    seats = None
    if artefact is not None:
        source = "artefact" if isinstance(artefact, Mapping) else str(artefact)
        seats = validate(source, {"artefact": to_artefact_content(artefact)}, ArtefactFile).artefact
        refuse_surfaces(seats, source, "`armd design`")
    experiment = design_first(content, parameters, readings, seats, bounds)
    return FirstDesignResult(experiment, arm, calibration, seats)


def _rows(experiment: FirstExperiment) -> list[dict[str, Any]]:
    """Make one row per pose: tip, target, and joint angles in degrees and in rad."""
    rows = []
    for i, (q, tip) in enumerate(zip(experiment.q, experiment.tip_mm, strict=True)):
        row: dict[str, Any] = {"pose": i + 1}
        if experiment.targets:
            row |= {"placement": experiment.placements[i], "target": experiment.targets[i]}
        row |= {f"{a}_mm": round(float(v), 1) for a, v in zip("xyz", tip, strict=True)}
        row |= {f"q{k}_deg": round(float(v), 1) for k, v in enumerate(np.degrees(q), 1)}
        rows.append(row | {f"q{k}": round(float(v), 9) for k, v in enumerate(q, 1)})
    return rows


def _in_words(experiment: FirstExperiment) -> list[str]:
    """Describe the quality of the poses in sentences."""
    n, full_rank = len(experiment.q), experiment.structural_rank
    setup = (
        f"on the artefact in {len(set(experiment.placements))} placements"
        if experiment.placements
        else "seen by a tracker in one placement"
    )
    condition = experiment.condition_number
    indices = ", ".join(f"{name} {v:.3g}" for name, v in experiment.observability.items())
    words = [
        f"{format_count(n, 'posture')} for a first calibration, {setup};"
        f" a certificate wants {experiment.certificate}.",
        f"Rank {experiment.rank} of {full_rank}, of {experiment.constants} constants: directions"
        f" known to a tenth of 10 mm or 0.02 rad, with {experiment.noise_mm:.2g} mm of noise a"
        f" reading. Structural rank {full_rank}: directions that move a point at all.",
        f"Observability {indices}; condition number"
        f" {'infinite' if condition is None else f'{condition:.3g}'}. Columns are scaled by 10 mm"
        " and 0.02 rad, placements and unknown targets eliminated.",
    ]
    words += [f"Not known: {unknown_quantity}." for unknown_quantity in experiment.not_known]
    if experiment.below_base:
        words.append(
            f"In {format_count(experiment.below_base, 'posture')} a part of the arm is lower than"
            " its base; `--lowest 0` keeps all of it above."
        )
    return words


def _is_rad(name: str) -> bool:
    return name[0] == "q" and name[1:].isdigit()

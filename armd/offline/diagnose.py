"""`diagnose`: the errors of a model, their causes, the extended model, the gain."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armd.compensation.diagnose.diagnose import diagnose as diagnose_loaded
from armd.compensation.diagnose.diagnosis import Diagnosis as Details
from armd.compensation.diagnose.fitting.under_test import has_reflectors
from armd.compensation.diagnose.predictive.curves import ResidualComparison, compare
from armd.compensation.diagnose.report.result import as_json
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.identify.admission.inconsistent_session import refuse_mistakes
from armd.compensation.identify.admission.mistakes import AssumedModel
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.progress import TellShare
from armd.offline.arm_model import ArmModel, PathText, resolve_arm
from armd.offline.calibration import Calibration, convert_calibration, resolve_calibration
from armd.offline.inputs.session import Sessions, load_sessions, resolve_sessions
from armd.offline.results.display import Displayed, Facts
from armd.offline.results.record import Record, make_records

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from armd.compensation.report.layout.about import About

COMMAND = "armd.diagnose"


class DiagnosisFinding(Record):
    """One finding: an entry of `findings` in `armd diagnose --json`, its keys as attributes."""

    cause: str
    """A name of docs/reference/causes.md, or `unknown`."""
    location: str
    """As `joint 3`."""
    probability: float
    parameters: list[Record]
    """Each with `name`, `value`, `unit`, `standard_uncertainty`."""
    alternatives: list[Record]
    """Each with `cause`, `location`, `probability`."""
    gain: Record
    """`heldout_rms_um_before`, `heldout_rms_um_after`, `interval_um` (95 %)."""

    def __repr__(self) -> str:
        return f"<{self.cause}, {self.location}: probability {self.probability:.3f}>"


class Diagnosis(Displayed):
    """The errors of a model and their causes; `diagnose` makes it."""

    def __init__(
        self, details: Details, arm: ArmModel, calibration: LoadedCalibration | None
    ) -> None:
        #: all results, in the form of armd's own functions; not public
        self.details = details
        self._arm = arm
        self._calibration = calibration

    @cached_property
    def _result(self) -> dict[str, Any]:
        return as_json(self.details, None)

    @cached_property
    def comparisons(self) -> list[ResidualComparison]:
        """The models' residuals compared with those of noise; computed once. Not public."""
        return compare(self.details)

    @cached_property
    def findings(self) -> list[DiagnosisFinding]:
        """The findings in the order in which they were added; none if nothing is significant."""
        return [DiagnosisFinding(make_records(finding)) for finding in self._result["findings"]]

    @property
    def sets(self) -> list[Record]:
        """Sets of causes in the arm that explain the readings, with `causes` and `probability`.

        The causes found come first, then other sets, the most probable first. Moved artefacts and
        outliers are in no set.
        """
        return [make_records(cause_set) for cause_set in self._result["sets"]]

    @property
    def baseline(self) -> Record:
        """The model under test: `rms_um`, `heldout_rms_um`, `noise_floor_um`."""
        record: Record = make_records(self._result["baseline"])
        return record

    @cached_property
    def extended(self) -> Calibration | None:
        """The model under test with the findings; None if there are none."""
        return convert_calibration(self.details.extended) if self.findings else None

    @property
    def next_experiment(self) -> str:
        """The next measurement to make, in one sentence."""
        return str(self._result["next_experiment"])

    def to_dict(self) -> dict[str, Any]:
        """Return the output of `armd diagnose --json`, with `extended_calibration` None.

        `predictive` takes a second or more the first time.
        """
        return self._result | {
            "predictive": [comparison.as_json() for comparison in self.comparisons]
        }

    def plot(self, finding: int | None = None, *, ax: Axes | None = None) -> Figure:
        """Draw the diagnosis; return the matplotlib figure.

        Without *finding*: measured and simulated residuals, under the model under test and with the
        findings. With it, the number of a finding (from 0): the residuals that show it, and the
        fitted effect. Raises `ValueError` for one that has no curve (moved artefacts, outliers).
        *ax*: axes to draw on; without *finding* they show the residuals that are farthest outside
        their band under the model under test.
        """
        from armd.compensation.report.diagnosis import predictive_plot
        from armd.compensation.report.diagnosis.signature_plot import draw_signature
        from armd.compensation.report.layout.drawing import make_single_figure

        index = None if finding is None else self._place(finding)
        if index is None and ax is None:
            return predictive_plot.draw_overview(self.comparisons)
        figure, panel = make_single_figure() if ax is None else (ax.get_figure(root=True), ax)
        assert figure is not None
        if index is not None:
            draw_signature(panel, self.details, index)
        elif self.comparisons:
            most_outside = predictive_plot.choose_most_outside(self.comparisons)
            predictive_plot.draw_curve(panel, most_outside, most_outside.before, "model under test")
        return figure

    def report(self, path: PathText) -> None:
        """Write the report of `armd diagnose` to *path*: HTML, or PDF by its suffix `.pdf`.

        Raises `armd.ArmdError` where no program prints a PDF.
        """
        from armd.compensation.report.layout.written import write_page

        write_page(Path(path), self.page(self._result))

    def page(self, result: dict[str, Any], about: About | None = None) -> str:
        """Return the report; *result* is that of `to_dict`, *about* is for its head. Not public."""
        from armd.compensation.report.diagnosis.page import make_diagnosis_report
        from armd.offline.results.pages import list_inputs

        files = list_inputs(self._arm, self._calibration)
        return make_diagnosis_report(self.details, result, files, self.comparisons, about)

    def _place(self, finding: int) -> int:
        index = finding - len(self.details.touched)  # they are listed first
        if not 0 <= index < len(self.details.findings):
            listed = len(self.findings)
            raise ValueError(f"finding {finding} of {listed} has no curve to draw")
        return index

    def _describe(self) -> tuple[str, Facts]:
        baseline = self.baseline
        facts = [
            ("3-D RMS", f"{baseline.rms_um:.2f} µm"),
            ("held-out 3-D RMS", f"{baseline.heldout_rms_um:.2f} µm"),
            ("noise alone", f"{baseline.noise_floor_um:.2f} µm"),
        ]
        for number, finding in enumerate(self.findings):
            gain = finding.gain
            after = f"{gain.heldout_rms_um_before:.2f} → {gain.heldout_rms_um_after:.2f} µm"
            words = f"{finding.cause}, {finding.location}: {finding.probability:.3f}, {after}"
            facts.append((f"finding {number}", words))
        facts += [("verdict", self._result["verdict"]), ("next", self.next_experiment)]
        return f"Diagnosis of arm {self._arm.serial_number}", facts


def diagnose(
    sessions: Sessions,
    arm: ArmModel | PathText,
    calibration: Calibration | PathText | None = None,
    holdout: Sessions | None = None,
    *,
    progress: TellShare = lambda _text, _share: None,
    command: str = COMMAND,
) -> Diagnosis:
    """Find the errors of a model and their causes: `armd diagnose`.

    *calibration*: the model under test; None: that of `calibrate` for the sessions. *holdout*:
    sessions that only judge the gain; None: placements are held out in turn. *progress* is called
    with each step and the share that is done, 0 to 1; *command* is recorded in `extended`.

    Raises `armd.BadInput` where the sessions cannot be used.

    >>> diagnosis = armd.diagnose(sorted(Path("sick").glob("session-*")), "sick/arm.toml")
    >>> diagnosis.findings[0].cause, diagnosis.findings[0].location
    ('encoder_eccentricity', 'joint 3')
    """
    model = resolve_arm(arm)
    loaded = resolve_calibration(calibration, model)
    content = loaded.content if loaded else None
    inspected = resolve_sessions(sessions)
    holdout_sessions = [] if holdout is None else resolve_sessions(holdout)
    fitted, held_out = load_sessions(inspected, model.content, holdout_sessions)
    assumed = AssumedModel.from_calibration(model.content, content) if content else None
    every = [*fitted, *held_out]
    if any(session.artefact.surfaces for session in every):
        evaluate(every, model.content, content)  # refuses surfaces that cannot be located
    artefact = content.artefact if content else None
    if not has_reflectors(every):
        refuse_mistakes(every, collect_observations(every, model.content, artefact), assumed)
    details = diagnose_loaded(fitted, model.content, content, held_out, progress, command)
    return Diagnosis(details, model, loaded)

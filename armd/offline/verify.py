"""`verify`: ISO 10360-12 and ASME B89.4.22 figures of a session, with a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from armd.compensation.data.sessions.points_only import refuse_reflectors
from armd.compensation.data.sessions.session import Session as StoredSession
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.identify.admission.mistakes import AssumedModel
from armd.compensation.identify.admission.wrong_names import refuse_misnamed
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.report.layout.about import About
from armd.compensation.verify.figures import correct_positions, evaluate_figures
from armd.compensation.verify.limits import PermissibleErrors, TestUncertainty, load_limits
from armd.compensation.verify.verdict import Verdict, judge
from armd.errors import ArmdError
from armd.files.schema import validate
from armd.offline.arm_model import ArmModel, PathText, resolve_arm
from armd.offline.calibration import Calibration, resolve_calibration
from armd.offline.inputs.session import Session, load_sessions, resolve_sessions
from armd.offline.results.display import Facts, Reported

LimitsInput = Mapping[str, Any] | PathText | None
Decision = Literal["guarded", "simple"]


class VerificationResult(Reported):
    """Figures of the standards and the verdict; `verify` makes it."""

    def __init__(
        self,
        verdict: Verdict,
        session: StoredSession,
        arm: ArmModel,
        calibration: LoadedCalibration | None,
        mpe: LimitsInput,
    ) -> None:
        #: all figures, in the form of armd's own functions; not public
        self.details = verdict
        self._session = session
        self._arm = arm
        self._calibration = calibration
        self._mpe = mpe

    @property
    def passed(self) -> bool | None:
        """Whether every figure with a limit was tested and conforms; None without limits."""
        return self.details.passed if self.details.limits else None

    @property
    def verdict(self) -> str:
        """The verdict in words: its scope, and the reasons where it is no."""
        return self.details.in_words

    def to_dict(self) -> dict[str, Any]:
        """Return the output of `armd verify --json`; lengths in mm."""
        return self.details.as_json()

    def page(self, about: About | None = None) -> str:
        """Return the report; *about* is for its head. Not public."""
        from armd.compensation.report.sessions import InputFile
        from armd.compensation.report.verification.page import make_verification_report
        from armd.offline.results.pages import hash_data, list_inputs

        files = list_inputs(self._arm, self._calibration)
        mpe = self._mpe
        is_data = isinstance(mpe, Mapping)
        files["limits"] = hash_data("as data", dict(mpe)) if is_data else InputFile.read(mpe)  # type: ignore[arg-type]
        return make_verification_report(
            self.details, self._session, self._arm.content, files, about
        )

    def _describe(self) -> tuple[str, Facts]:
        facts = [
            (item.figure.name, f"{1e3 * item.deciding.value_mm:+.1f} µm, {item.outcome}")
            for item in self.details.judged
        ]
        facts += [(key, f"left out: {why}") for key, why in self._left_out().items()]
        facts.append(("verdict", self.verdict))
        return f"Verification of arm {self._arm.serial_number}", facts

    def _left_out(self) -> dict[str, str]:
        return self.details.verification.left_out


def verify(
    session: Session | PathText,
    arm: ArmModel | PathText,
    calibration: Calibration | PathText | None = None,
    mpe: LimitsInput = None,
    *,
    decision: Decision | None = None,
) -> VerificationResult:
    """Judge an arm by ISO 10360-12 and ASME B89.4.22: `armd verify` of a session.

    The names of the session's targets determine its tests (docs/how-to/verify.md). *calibration*:
    None means the nominal geometry. *mpe*: limits as the path of an mpe.toml or as a dict of its
    content, `{"mpe": {"e_uni_mm": 0.04}}`; None: no verdict. *decision*: `"guarded"` or `"simple"`,
    instead of that in the limits.

    Raises `armd.BadInput` for invalid files, `armd.ArmdError` where no test is complete.

    >>> armd.verify("test/verify", "test/arm.toml", mpe={"mpe": {"e_uni_mm": 5.0}}).passed
    True
    """
    limits = resolve_limits(mpe, decision)
    model = resolve_arm(arm)
    loaded = resolve_calibration(calibration, model)
    content = loaded.content if loaded else None
    (read,), _ = load_sessions(resolve_sessions(session), model.content)
    refuse_reflectors([read], "`armd verify`")
    # This comes first, because it refuses a calibration that overflows.
    position = correct_positions(read, model.content, loaded)
    observations = collect_observations(
        [read], model.content, content.artefact if content else None
    )
    refuse_misnamed([read], observations, AssumedModel.from_calibration(model.content, content))
    if surfaces := bool(read.artefact.surfaces):
        evaluate([read], model.content, content)  # refuses those that cannot be located
    test = limits.uncertainty if limits else TestUncertainty()
    must_be_complete = limits is not None or not surfaces
    verdict = judge(
        evaluate_figures(read, model.content, position, test, complete=must_be_complete), limits
    )
    require_judged(verdict, str(read.path))
    return VerificationResult(verdict, read, model, loaded, mpe)


def resolve_limits(mpe: LimitsInput, decision: Decision | None = None) -> PermissibleErrors | None:
    """Return the limits, read if they are a path; raises `BadInput`."""
    if mpe is None:
        return None
    if isinstance(mpe, Mapping):
        limits = validate("mpe", dict(mpe), PermissibleErrors)
    else:
        limits = load_limits(Path(mpe))
    return limits.model_copy(update={"decision": decision}) if decision else limits


def require_judged(verdict: Verdict, name: str) -> None:
    """Raise `ArmdError`, which calls the readings *name*, unless a test is complete."""
    if not verdict.judged:
        reasons = "; ".join(dict.fromkeys(verdict.verification.left_out.values()))
        raise ArmdError(f"{name}: no test is complete: {reasons}")

"""The judgement of a history of checks as values: changes, epochs, the judgement."""

from __future__ import annotations

from dataclasses import dataclass

from armd.arrays import F64
from armd.compensation.interim.changes.change import Change, ChangeScenario, ChangesFound
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.checks.history import Check
from armd.compensation.interim.evidence.stack import Stack
from armd.compensation.interim.report.growth import FittedGrowth
from armd.compensation.model.calibration import Calibration


@dataclass(frozen=True, kw_only=True)
class ReportedChange:
    """One change as it is reported."""

    change: Change
    cause: Cause | None
    rivals: tuple[tuple[Cause, float], ...]
    between_unix_s: tuple[float, float]
    instant_unix_s: float  # from then on the calibration contains it
    values: F64  # (p,) at the last check, in the columns' units
    deviations: F64  # (p,) their standard uncertainties
    per_day: F64 | None  # (p,) of a growth, its mean rate
    tip_rms_um: float
    calibration: Calibration | None  # with this change and all earlier ones


@dataclass(frozen=True)
class Epoch:
    """Checks under one calibration and one description of the arm, with their results."""

    checks: tuple[Check, ...]
    stack: Stack
    causes: tuple[Cause, ...]
    detected: ChangesFound
    reported_changes: tuple[ReportedChange, ...]
    scenarios: tuple[ChangeScenario, ...]  # the possible histories of all changes
    grown: FittedGrowth | None = None  # growth of the links, if the calibration lacks it

    def verdict(self, index: int) -> str:
        if index in self.detected.bad:
            return "bad_check"
        changed = any(index >= change.first for change in self.detected.changes)
        return "changed" if changed else "in_control"


@dataclass(frozen=True)
class Judgement:
    """The judgement of a history; the epoch of the latest check decides the state."""

    epochs: tuple[Epoch, ...]
    far_off: tuple[str, ...] = ()  # single readings that are far off, in words

    @property
    def checks(self) -> list[Check]:
        """The checks of all epochs, in time."""
        checks = (check for epoch in self.epochs for check in epoch.checks)
        return sorted(checks, key=lambda check: check.line.first_unix_s)

    @property
    def latest(self) -> Epoch:
        return max(self.epochs, key=lambda epoch: epoch.checks[-1].line.first_unix_s)

    @property
    def changed(self) -> bool:
        return bool(self.latest.reported_changes)

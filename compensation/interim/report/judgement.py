"""What a history of checks says of the arm, as values: changes, epochs, the judgement."""

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
    """One change as it is told."""

    change: Change
    cause: Cause | None
    rivals: tuple[tuple[Cause, float], ...]
    between_unix_s: tuple[float, float]
    instant_unix_s: float  # from when on the calibration has it
    values: F64  # (p,) at the last check, in the columns' units
    deviations: F64  # (p,) their standard uncertainties
    per_day: F64 | None  # (p,) of a growth, its mean rate
    tip_rms_um: float
    calibration: Calibration | None  # with this change and all earlier ones


@dataclass(frozen=True)
class Epoch:
    """Checks under one calibration, and what they say."""

    checks: tuple[Check, ...]
    stack: Stack
    causes: tuple[Cause, ...]
    detected: ChangesFound
    reported_changes: tuple[ReportedChange, ...]
    scenarios: tuple[ChangeScenario, ...]  # in which all changes may have been
    grown: FittedGrowth | None = None  # how the links grow, where the calibration could not know it

    def verdict(self, index: int) -> str:
        if index in self.detected.bad:
            return "bad_check"
        changed = any(index >= change.first for change in self.detected.changes)
        return "changed" if changed else "in_control"


@dataclass(frozen=True)
class Judgement:
    """What a history says; the epoch of the latest check decides the state."""

    epochs: tuple[Epoch, ...]
    far_off: tuple[str, ...] = ()  # single readings, in words

    @property
    def checks(self) -> list[Check]:
        """Of all epochs, in time."""
        checks = (check for epoch in self.epochs for check in epoch.checks)
        return sorted(checks, key=lambda check: check.line.first_unix_s)

    @property
    def latest(self) -> Epoch:
        return max(self.epochs, key=lambda epoch: epoch.checks[-1].line.first_unix_s)

    @property
    def changed(self) -> bool:
        return bool(self.latest.reported_changes)

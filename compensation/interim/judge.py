"""The whole of `armd interim`: what a history of checks says of the arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import numpy.typing as npt
from threadpoolctl import threadpool_limits

from armd.compensation.interim.amend import Amplitudes, amended, at_the_end, fit
from armd.compensation.interim.changes import Change, Found, find
from armd.compensation.interim.columns import Cause, causes_of
from armd.compensation.interim.history import Check, iso
from armd.compensation.interim.reach import tip_rms_um
from armd.compensation.interim.stack import DAY_S, Stack, stack
from armd.compensation.model.calibration import Calibration

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Told:
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
    found: Found
    told: tuple[Told, ...]

    def verdict(self, index: int) -> str:
        if index in self.found.bad:
            return "bad_check"
        changed = any(index >= change.first for change in self.found.changes)
        return "changed" if changed else "in_control"


@dataclass(frozen=True)
class Judgement:
    """What a history says; the epoch of the latest check decides the state."""

    epochs: tuple[Epoch, ...]

    @property
    def latest(self) -> Epoch:
        return max(self.epochs, key=lambda epoch: epoch.checks[-1].line.first_unix_s)

    @property
    def changed(self) -> bool:
        return bool(self.latest.told)


def judge(checks: Sequence[Check]) -> Judgement:
    """Judge *checks* in order of time, epoch by epoch."""
    with threadpool_limits(limits=1, user_api="blas"):
        ordered = sorted(checks, key=lambda check: check.epoch)
        groups = [tuple(group) for _, group in groupby(ordered, key=lambda check: check.epoch)]
        by_time = [tuple(sorted(g, key=lambda check: check.line.first_unix_s)) for g in groups]
        epochs = [_epoch(group) for group in by_time]
    return Judgement(tuple(sorted(epochs, key=lambda e: e.checks[0].line.first_unix_s)))


def _epoch(checks: tuple[Check, ...]) -> Epoch:
    arm, calibration = checks[0].arm, checks[0].calibration
    causes = causes_of(arm, calibration.content)
    stacked = stack([check.reduced for check in checks], causes)
    found = find(stacked, causes)
    amplitudes = fit(stacked, causes, found.changes, found.bad)
    instants = [_instant(checks, stacked, change) for change in found.changes]
    told = tuple(
        _told(checks, stacked, causes, found, amplitudes, instants, index)
        for index in range(len(found.changes))
    )
    return Epoch(checks, stacked, tuple(causes), found, told)


def _told(
    checks: Sequence[Check],
    of: Stack,
    causes: Sequence[Cause],
    found: Found,
    amplitudes: Amplitudes,
    instants: Sequence[float],
    index: int,
) -> Told:
    change = found.changes[index]
    between = _between(checks, of, change)
    if change.cause is None:
        nothing = np.zeros(0)
        return Told(
            change, None, (), between, instants[index], nothing, nothing, None, np.nan, None
        )
    cause = causes[change.cause]
    own = amplitudes.values[index]
    values = at_the_end(of, change, own)
    covariance = amplitudes.covariance[(at := amplitudes.slice_of(index)), at]
    root = np.kron(_end_shape(of, change), np.eye(own.shape[1]))
    deviations = np.sqrt(np.maximum(np.diag(root @ covariance @ root.T), 0.0))
    grown_d = float(of.time_d[-1]) - change.origin_d
    last = checks[-1]
    calibration = amended(
        last.calibration.content,
        of,
        checks[0].reduced.mean_unix_s,
        causes,
        found.changes[: index + 1],
        instants[: index + 1],
        amplitudes,
        last.reduced.last_unix_s,
        {
            "calibration": last.calibration.sha256,
            "checks": [check.line.name for check in checks],
            "changes": [
                f"{c.candidate.cause} {c.candidate.location} since {iso(round(at))}"
                for c, at in (
                    (causes[ch.cause], at)
                    for ch, at in zip(found.changes[: index + 1], instants, strict=False)
                    if ch.cause is not None
                )
            ],
        },
    )
    return Told(
        change=change,
        cause=cause,
        rivals=tuple((causes[k], share) for k, share in change.rivals),
        between_unix_s=between,
        instant_unix_s=instants[index],
        values=values,
        deviations=deviations,
        per_day=values / grown_d if change.gradual else None,
        tip_rms_um=tip_rms_um(last.arm, last.calibration.content, cause.candidate, values),
        calibration=calibration,
    )


def _end_shape(of: Stack, change: Change) -> F64:
    from armd.compensation.interim.changes import shapes

    return shapes(of, change)[-1:]


def _between(checks: Sequence[Check], of: Stack, change: Change) -> tuple[float, float]:
    """What holds the change's instant: from the last check without it to the first that has it."""
    until = checks[change.latest].reduced.first_unix_s
    before = change.earliest - 1
    gap = float(np.median(np.diff(of.time_d))) * DAY_S if of.n > 1 else DAY_S
    if not change.gradual:
        since = checks[before].reduced.last_unix_s if before >= 0 else until - gap
        return since, until
    # A growth is dated to a check; it may as well have begun between that and its neighbours.
    if before >= 1:
        middle = (checks[before - 1].reduced.mean_unix_s + checks[before].reduced.mean_unix_s) / 2
        return middle, until
    return checks[0].reduced.first_unix_s - gap, until


def _instant(checks: Sequence[Check], of: Stack, change: Change) -> float:
    """From when on the calibration has a change: halfway between two checks, or where it began."""
    begun = checks[0].reduced.mean_unix_s
    if change.gradual:
        return begun + change.origin_d * DAY_S
    if change.first == 0:
        gap = float(np.median(np.diff(of.time_d))) * DAY_S if of.n > 1 else DAY_S
        return checks[0].reduced.first_unix_s - gap / 2
    before = checks[change.first - 1].reduced.last_unix_s
    return (before + checks[change.first].reduced.first_unix_s) / 2

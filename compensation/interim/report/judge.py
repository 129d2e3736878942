"""The complete judgement of `armd interim` on the arm of a history of checks."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from threadpoolctl import threadpool_limits

from armd.compensation.interim.changes.change import ChangesFound, add_known_changes, compute_shapes
from armd.compensation.interim.changes.dates import find_instant, find_interval
from armd.compensation.interim.changes.find import find
from armd.compensation.interim.changes.scenarios import list_scenarios
from armd.compensation.interim.checks.columns import Cause, list_causes
from armd.compensation.interim.checks.history import Check, format_iso
from armd.compensation.interim.evidence.likelihood import fit_standing_share
from armd.compensation.interim.evidence.looks import EpochLooks
from armd.compensation.interim.evidence.stack import Stack, join_checks
from armd.compensation.interim.report.amend import (
    Amplitudes,
    compute_final_size,
    extend_calibration,
    fit,
)
from armd.compensation.interim.report.average import (
    Averaged,
    choose_affordable,
    compute_average,
)
from armd.compensation.interim.report.growth import find_growth
from armd.compensation.interim.report.judgement import Epoch, Judgement, ReportedChange
from armd.compensation.interim.report.reach import compute_tip_rms_um
from armd.compensation.interim.report.watch_memory import NOTHING, Remembered
from armd.compensation.model.calibration import Calibration


def judge(checks: Sequence[Check], remembered: Remembered = NOTHING) -> Judgement:
    """Judge *checks* in order of time, epoch by epoch; what is *remembered* is not
    watched again.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        ordered = sorted(checks, key=lambda check: check.epoch)
        groups = [tuple(group) for _, group in groupby(ordered, key=lambda check: check.epoch)]
        by_time = [tuple(sorted(g, key=lambda check: check.line.first_unix_s)) for g in groups]
        epochs = [_judge_epoch(group, remembered.recall_looks(group)) for group in by_time]
    return Judgement(tuple(sorted(epochs, key=lambda e: e.checks[0].line.first_unix_s)))


def _judge_epoch(checks: tuple[Check, ...], before: EpochLooks) -> Epoch:
    arm, calibration = checks[0].arm, checks[0].calibration
    causes = list_causes(arm, calibration.content)
    reduced = [check.reduced for check in checks]
    stacked = fit_standing_share(join_checks(reduced, causes))
    detected = find(stacked, causes, before)
    # The size of the standing errors is estimated again, given the changes and without the bad
    # checks.
    good = [i for i in range(stacked.n) if i not in detected.bad]
    explained = add_known_changes(stacked, detected.changes).select_checks(good)
    stacked = stacked.rescale(fit_standing_share(explained).share / stacked.share)
    amplitudes = fit(stacked, causes, detected.changes, detected.bad)
    instants = [find_instant(reduced, stacked, change, detected.bad) for change in detected.changes]
    possible = list_scenarios(stacked, causes, detected.changes, detected.bad)
    grown = find_growth(checks, stacked, causes, detected.changes, detected.bad)
    under = calibration.content if grown is None else grown.calibration
    rows = len(under.covariance_of)
    every = compute_average(
        stacked, causes, choose_affordable(possible, causes, rows), detected.bad
    )
    reported_changes = tuple(
        _report_change(
            index, checks, stacked, causes, detected, amplitudes, instants, every=every, under=under
        )
        for index in range(len(detected.changes))
    )
    return Epoch(checks, stacked, tuple(causes), detected, reported_changes, tuple(possible), grown)


def _report_change(
    index: int,
    checks: Sequence[Check],
    stacked: Stack,
    causes: Sequence[Cause],
    detected: ChangesFound,
    amplitudes: Amplitudes,
    instants: Sequence[float],
    *,
    every: Averaged,
    under: Calibration,
) -> ReportedChange:
    """Report one change; *under* is the calibration that it is added to, with the links' growth."""
    change = detected.changes[index]
    reduced = [check.reduced for check in checks]
    interval = find_interval(reduced, stacked, change, detected.bad)
    if change.cause is None:
        nothing = np.zeros(0)
        return ReportedChange(
            change=change,
            cause=None,
            rivals=(),
            between_unix_s=interval,
            instant_unix_s=instants[index],
            values=nothing,
            deviations=nothing,
            per_day=None,
            tip_rms_um=np.nan,
            calibration=None,
        )
    cause = causes[change.cause]
    own_amplitudes = amplitudes.values[index]
    values = compute_final_size(stacked, change, own_amplitudes)
    covariance = amplitudes.covariance[(place := amplitudes.slice_of(index)), place]
    root = np.kron(compute_shapes(stacked, change)[-1:], np.eye(own_amplitudes.shape[1]))
    deviations = np.sqrt(np.maximum(np.diag(root @ covariance @ root.T), 0.0))
    grown_d = float(stacked.time_d[-1]) - change.origin_d
    last = checks[-1]
    possible = every.changes[: every.count_until(index)]
    calibration = extend_calibration(
        under,
        reduced[0].mean_unix_s,
        causes,
        possible,
        [
            find_instant(reduced, stacked, possible_change, detected.bad)
            for possible_change in possible
        ],
        every.amplitudes,
        last.reduced.last_unix_s,
        {
            "calibration": last.calibration.sha256,
            "checks": [check.line.name for check in checks],
            "changes": [
                f"{c.candidate.cause} {c.candidate.location} since {format_iso(round(begin))}"
                for c, begin in (
                    (causes[ch.cause], begin)
                    for ch, begin in zip(detected.changes[: index + 1], instants, strict=False)
                    if ch.cause is not None
                )
            ],
            "averaged_over": _compute_shares(every, causes, index),
        },
    )
    return ReportedChange(
        change=change,
        cause=cause,
        rivals=tuple((causes[k], share) for k, share in change.rivals),
        between_unix_s=interval,
        instant_unix_s=instants[index],
        values=values,
        deviations=deviations,
        per_day=values / grown_d if change.gradual else None,
        tip_rms_um=compute_tip_rms_um(last.arm, last.calibration.content, cause.candidate, values),
        calibration=calibration,
    )


def _compute_shares(every: Averaged, causes: Sequence[Cause], index: int) -> list[dict[str, float]]:
    """Return, for each change, the share of each cause at its place in the average."""
    shares: list[dict[str, float]] = [{} for _ in range(index + 1)]
    for change, number, share in zip(every.changes, every.of_change, every.shares, strict=True):
        if change.cause is not None and number <= index:
            cause, location = causes[change.cause].place
            name = f"{cause} {location}"
            shares[number][name] = shares[number].get(name, 0.0) + share
    return shares

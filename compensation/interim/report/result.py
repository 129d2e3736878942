"""A judgement as `armd interim … --json` writes it (the contract's section 13), and in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.checks.history import Check, format_iso
from armd.compensation.interim.evidence.likelihood import LIMIT, RUN_LENGTH
from armd.compensation.interim.report.growth import SURE, FittedGrowth
from armd.compensation.interim.report.judgement import Epoch, Judgement, ReportedChange
from armd.compensation.wording import ARC_SECOND, format_minute, format_plain
from armd.terminal.counted import format_count

#: Decimals of a statistic: further digits depend on which checks were watched at one time.
DECIMALS = 6


def as_json(
    judgement: Judgement,
    calibrations: Sequence[tuple[str, str] | None],
    tomorrow: dict[str, Any] | None,
    with_growth: tuple[str, str] | None = None,
) -> dict[str, Any]:
    """Return the whole result as plain data.

    *calibrations* are file and SHA-256 for each change, in order; *with_growth* are those of the
    calibration that contains the growth of the links.
    """
    changes = [
        (reported, epoch) for epoch in judgement.epochs for reported in epoch.reported_changes
    ]
    checks = [
        (check, epoch, i) for epoch in judgement.epochs for i, check in enumerate(epoch.checks)
    ]
    checks.sort(key=lambda row: row[0].line.first_unix_s)
    latest = judgement.latest.checks[-1]
    return {
        "schema": "armd.interim/1",
        "state": "changed" if judgement.changed else "in_control",
        "arm": latest.line.arm,
        "calibration": latest.calibration.sha256,
        "last_check": latest.line.started,
        "in_control_run_length": RUN_LENGTH,
        "checks": [_describe_check(*row) for row in checks],
        "changes": [
            _describe_change(reported, epoch, *(file or (None, None)))
            for (reported, epoch), file in zip(changes, calibrations, strict=True)
        ],
        "growth": _describe_growth(judgement.latest.grown, *(with_growth or (None, None))),
        "far_off": list(judgement.far_off),
        "next_check": tomorrow,
    }


def _describe_check(check: Check, epoch: Epoch, index: int) -> dict[str, Any]:
    statistic = float(epoch.detected.statistic[index])
    return {
        "name": check.line.name,
        "started": check.line.started,
        "statistic": round(statistic, DECIMALS) if math.isfinite(statistic) else 0.0,
        "limit": LIMIT,
        "verdict": epoch.verdict(index),
        "readings": check.reduced.readings,
        "rms_um": check.reduced.rms_um,
        "calibration": check.line.calibration,
    }


def _describe_growth(
    grown: FittedGrowth | None, path: str | None, sha256: str | None
) -> dict[str, Any] | None:
    if grown is None:
        return None
    before_um, after_um = grown.heldout_um
    return {
        "links": [
            {
                "cause": "link_expansion",
                "location": link.location,
                "parameters": [
                    {
                        "name": "per kelvin",
                        "value": link.per_k,
                        "unit": "1/K",
                        "standard_uncertainty": link.standard_uncertainty,
                    }
                ],
            }
            for link in grown.links
        ],
        "separable": grown.separable,
        "heldout_rms_um_before": before_um,
        "heldout_rms_um_after": after_um,
        "calibration_from": path,
        "calibration_sha256": sha256,
        "reading": describe_growth(grown),
    }


def describe_growth(grown: FittedGrowth) -> str:
    """Describe the growth in a few sentences, for the console and the page."""
    before_um, after_um = grown.heldout_um
    sizes = ", ".join(
        f"{link.location} by {format_plain(1e6 * link.per_k, sign='+')} ± "
        f"{format_plain(1e6 * SURE * link.standard_uncertainty)}"
        for link in grown.links
    )
    which = "" if grown.separable else "together (these checks cannot separate them) "
    return (
        f"The calibration was made within {format_plain(grown.made_within_k)} K and contains no "
        f"thermal expansion. The checks show it: the links expand {which}in µm per metre and "
        f"kelvin (95 %): {sizes}. This is no change of the arm. With it, checks held out "
        f"in turn err by {format_plain(after_um)} µm instead of {format_plain(before_um)} µm."
    )


def _describe_change(
    reported: ReportedChange, epoch: Epoch, path: str | None, sha256: str | None
) -> dict[str, Any]:
    change, cause = reported.change, reported.cause
    low, high = reported.between_unix_s
    entry: dict[str, Any] = {
        "between": [format_iso(math.floor(low)), format_iso(math.ceil(high))],
        "cause": "unknown" if cause is None else cause.candidate.cause,
        "location": "-" if cause is None else str(cause.candidate.location),
        "probability": change.probability,
        "alternatives": [
            {
                "cause": rival.candidate.cause,
                "location": str(rival.candidate.location),
                "probability": share,
            }
            for rival, share in reported.rivals
        ],
        "gradual": change.gradual,
        "gradual_probability": change.gradual_probability,
        "tip_rms_um": None if math.isnan(reported.tip_rms_um) else reported.tip_rms_um,
        "calibration_from": path,
        "calibration_sha256": sha256,
        "judged_under": epoch.checks[0].calibration.sha256,
        "from": None
        if math.isnan(reported.instant_unix_s)
        else format_iso(round(reported.instant_unix_s)),
        "reading": describe_change(reported),
        "parameters": [],
    }
    if cause is not None:
        entry["parameters"] = [
            {
                "name": column.name,
                "value": float(value),
                "unit": column.unit,
                "standard_uncertainty": float(deviation),
                **({} if reported.per_day is None else {"per_day": float(reported.per_day[j])}),
            }
            for j, (column, value, deviation) in enumerate(
                zip(cause.candidate.columns, reported.values, reported.deviations, strict=True)
            )
        ]
    return entry


def describe_change(reported: ReportedChange) -> str:
    """Describe a change in one sentence."""
    if reported.cause is None:
        return "since then the checks are off in a way that no cause of the catalogue makes"
    candidate = reported.cause.candidate
    if candidate.cause == "encoder_slip":
        size = format_plain(abs(float(reported.values[0])) / ARC_SECOND)
        text = f"the index of {candidate.location} slipped by {size}″"
    else:
        text = CATALOGUE[candidate.cause].describe(candidate, reported.values)
    if reported.per_day is not None:
        days = abs(float(reported.values[0] / reported.per_day[0])) if reported.per_day[0] else 0.0
        text += f" by the last check, grown over {format_plain(days)} days"
    return text


def name_cause(cause: Cause) -> str:
    """Return a cause and its place in words."""
    return f"{cause.candidate.cause.replace('_', ' ')} ({cause.candidate.location})"


def describe_judgement(judgement: Judgement) -> list[str]:
    """Describe the result in sentences, for the console and the page."""
    latest = judgement.latest
    last = latest.checks[-1]
    count = sum(len(epoch.checks) for epoch in judgement.epochs)
    lines = []
    if not judgement.changed:
        lines.append(
            f"In control: {format_count(count, 'check')}, the last "
            f"{last.line.name} of {format_minute(last.reduced.first_unix_s)}."
        )
    for reported in (reported for epoch in judgement.epochs for reported in epoch.reported_changes):
        low, high = reported.between_unix_s
        how = "growing since" if reported.change.gradual else "changed"
        lines.append(
            f"{how.capitalize()} between {format_minute(low)} and {format_minute(high)} (95 %):"
            f" {describe_change(reported)} [probability {reported.change.probability:.2f}]."
        )
        if not math.isnan(reported.tip_rms_um):
            tip_um = format_plain(reported.tip_rms_um)
            lines.append(f"Over the arm's reach that is {tip_um} µm RMS at the tip.")
        if reported.rivals:
            rivals = ", ".join(
                f"{name_cause(rival)} {share:.2f}" for rival, share in reported.rivals[:4]
            )
            lines.append(f"It could also be {rivals}.")
    bad = [epoch.checks[i].line.name for epoch in judgement.epochs for i in epoch.detected.bad]
    if bad:
        lines.append(
            f"Bad by {'itself' if len(bad) == 1 else 'themselves'}, and no change: {', '.join(bad)}"
            " (dirt in a seat, or another artefact)."
        )
    if latest.grown is not None:
        lines.append(describe_growth(latest.grown))
    lines += [f"Far off: {line}." for line in judgement.far_off]
    if judgement.far_off:
        lines.append("In the air, or beside its seat? Then measure that check again.")
    return lines

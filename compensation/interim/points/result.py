"""The result of a history of tables of points, as JSON (the form of `armd interim`) and
in words.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from armd.compensation.interim.checks.history import format_iso
from armd.compensation.interim.points.evidence import LIMIT, RUN_LENGTH
from armd.compensation.interim.points.figures import ARM
from armd.compensation.interim.points.find import PointChange
from armd.compensation.interim.points.judge import FigureShift, PointEpoch
from armd.compensation.wording import format_minute, format_plain
from armd.terminal.counted import format_count

NEXT = "the same check again: the same targets, as often, in the same places of the arm's volume"
CONFIRM = (
    "the same check again, which confirms it; after a repair or a new calibration of the arm"
    " begin a history of its own (--history)"
)
#: Decimals of a statistic.
DECIMALS = 6
#: The most figures of a change in its sentence.
IN_WORDS = 3
#: With fewer checks only large changes are detected.
FIRST_CHECKS = 5


def format_points(epochs: Sequence[PointEpoch]) -> dict[str, Any]:
    """Format the whole result as plain data; the last epoch decides the state."""
    checks = sorted(
        ((epoch, i) for epoch in epochs for i in range(len(epoch.checks))),
        key=lambda pair: pair[0].checks[pair[1]].first_unix_s,
    )
    latest = epochs[-1]
    changed = bool(latest.detected.changes)
    return {
        "schema": "armd.interim/1",
        "state": "changed" if changed else "in_control",
        "arm": ARM,
        "calibration": "",
        "artefact": latest.checks[-1].artefact,
        "last_check": format_iso(latest.checks[-1].first_unix_s),
        "in_control_run_length": RUN_LENGTH,
        "checks": [_describe_check(epoch, i) for epoch, i in checks],
        "changes": [
            _describe_change(epoch, change, moved)
            for epoch in epochs
            for change, moved in zip(epoch.detected.changes, epoch.moved, strict=True)
        ],
        "growth": None,
        "far_off": [],
        "next_check": {"sentence": CONFIRM if changed else NEXT},
    }


def _describe_check(epoch: PointEpoch, index: int) -> dict[str, Any]:
    check, statistic = epoch.checks[index], float(epoch.detected.statistic[index])
    return {
        "name": check.name,
        "started": format_iso(check.first_unix_s),
        "statistic": round(statistic, DECIMALS) if math.isfinite(statistic) else 0.0,
        "limit": LIMIT,
        "verdict": epoch.verdict(index),
        "figures_um": {figure.name: 1e3 * figure.value_mm for figure in check.figures},
        "artefact": check.artefact,
    }


def _describe_change(
    epoch: PointEpoch, change: PointChange, moved: Sequence[FigureShift]
) -> dict[str, Any]:
    low, high = epoch.between_unix_s(change)
    return {
        "between": [format_iso(math.floor(low)), format_iso(math.ceil(high))],
        "cause": "unknown",
        "location": "-",
        "probability": change.probability,
        "alternatives": [],
        "gradual": change.course.gradual,
        "tip_rms_um": None,
        "calibration_from": None,
        "calibration_sha256": None,
        "judged_under": "",
        "from": format_iso(round(high)),
        "reading": _reading(moved),
        "parameters": [],
        "figures": [
            {
                "name": figure.name,
                "before_um": figure.before_um,
                "change_um": figure.change_um,
                "standard_uncertainty_um": figure.standard_uncertainty_um,
                "interval_um": [
                    figure.change_um - figure.half_width_um,
                    figure.change_um + figure.half_width_um,
                ],
                "significant": figure.significant,
            }
            for figure in moved
        ],
    }


def _reading(moved: Sequence[FigureShift]) -> str:
    """Describe the sizes of a change: the significant figures, the most significant first."""
    listed = [figure for figure in moved if figure.significant][:IN_WORDS] or list(moved[:1])
    sizes = ", ".join(
        f"{figure.name} by {format_plain(figure.change_um, sign='+')}"
        f" ± {format_plain(figure.half_width_um)} µm"
        for figure in listed
    )
    n_more = sum(figure.significant for figure in moved) - len(listed)
    return sizes + (f", and {format_count(n_more, 'further figure')}" if n_more > 0 else "")


def describe_points(epochs: Sequence[PointEpoch]) -> list[str]:
    """Describe the result in sentences, for the console and the page."""
    latest = epochs[-1]
    count = sum(len(epoch.checks) for epoch in epochs)
    last = latest.checks[-1]
    lines = []
    if not latest.detected.changes:
        lines.append(
            f"In control: {format_count(count, 'check')}, the last {last.name} of"
            f" {format_minute(last.first_unix_s)}."
        )
        if len(latest.checks) < FIRST_CHECKS:
            n_more = FIRST_CHECKS - len(latest.checks)
            lines.append(
                f"Few checks yet: only a large change shows. {format_count(n_more, 'more check')}"
                " will tell how far checks of this arm scatter."
            )
    for epoch in epochs:
        for change, moved in zip(epoch.detected.changes, epoch.moved, strict=True):
            low, high = epoch.between_unix_s(change)
            how, link = (
                ("Growing since", "or") if change.course.gradual else ("Changed between", "and")
            )
            lines.append(
                f"{how} {format_minute(low)} {link} {format_minute(high)}"
                f" (95 %): {_reading(moved)} (95 %) [probability {change.probability:.2f}]."
            )
    bad = [epoch.checks[i].name for epoch in epochs for i in epoch.detected.bad]
    if bad:
        lines.append(
            f"Bad by {'itself' if len(bad) == 1 else 'themselves'}, and no change: "
            f"{', '.join(bad)} (dirt in a seat, or a loose artefact)."
        )
    return lines

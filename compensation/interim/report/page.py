"""The HTML page of a history of checks: the statistic, the residuals, and each change over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from armd.arrays import F64
from armd.compensation.data.sessions.files import READINGS
from armd.compensation.data.sessions.session import Session
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.interim.changes.change import compute_shapes
from armd.compensation.interim.evidence.likelihood import RUN_LENGTH
from armd.compensation.interim.report.judgement import Epoch, Judgement, ReportedChange
from armd.compensation.interim.report.result import describe_judgement
from armd.compensation.report.checks import LOOK, draw_by_verdict, draw_statistics, to_instants
from armd.compensation.report.coverage import add_coverage
from armd.compensation.report.layout.about import About
from armd.compensation.report.layout.drawing import COLOURS, make_single_figure
from armd.compensation.report.layout.head import add_head
from armd.compensation.report.layout.page import MOST_SENTENCES, Page, make_report_number
from armd.compensation.report.layout.units import Unit, choose_units
from armd.compensation.report.sessions import add_session_facts
from armd.compensation.wording import ARC_SECOND, format_minute, format_plain

#: Those of a check's files that were measured.
MEASURED = ("session.toml", *READINGS)
#: Units in the report: their names, and their number in one unit of the model.
SHOWN = {"rad": ("″", 1 / ARC_SECOND), "mm": ("µm", 1e3), "rad/Nm": ("µrad/Nm", 1e6)}


def render_interim_page(
    judgement: Judgement,
    result: dict[str, Any],
    sessions: Sequence[Session],
    about: About | None = None,
) -> str:
    """Render the report as HTML text; *sessions* are the checks as they were measured, in time."""
    arm = judgement.latest.checks[-1].arm
    page, unit = (
        Page(f"Interim checks of arm {result['arm']}", result["arm"]),
        choose_units(arm).length,
    )
    first, *further_sentences = describe_judgement(judgement)
    reason = page.abbreviate("Verdict", first.removeprefix("In control: "))
    page.add_verdict(
        "CHANGED" if judgement.changed else "IN CONTROL", reason, not judgement.changed,
        _write_key_sentence(result["checks"], unit),
    )  # fmt: skip
    add_head(page, arm, sessions, about)
    page.add_items_in_brief("What the checks show", further_sentences, MOST_SENTENCES)
    if result["next_check"]:
        page.add_text(f"Next: {result['next_check']['sentence']}")
    page.add_text(
        "Decision rule: a change is reported where the statistic reaches its limit: without one,"
        f" about once in {RUN_LENGTH:.0f} checks. It is Shiryaev's and Roberts's: how "
        "much likelier the readings are with a change than without, over all instants and causes."
    )
    checks = result["checks"]
    page.add_figure(draw_statistics(checks), "The statistic of each check, and its limit")
    page.add_figure(
        _draw_residuals(checks, unit),
        f"Residuals of each check under the calibration, {unit.name} RMS",
    )
    add_coverage(page, arm, sessions)
    page.add_signature_lines("Checked by")
    page.begin_appendix()
    for epoch in judgement.epochs:
        for reported in epoch.reported_changes:
            if reported.cause is None:
                continue
            candidate = reported.cause.candidate
            page.add_heading(f"{candidate.cause.replace('_', ' ')}, {candidate.location}")
            page.add_text(f"{CATALOGUE[candidate.cause].reason}.".capitalize())
            page.add_figure(
                _draw_over_time(epoch, reported),
                "Amplitude in each check alone (bars: two standard uncertainties), the course that"
                " is reported, and the interval that holds the change",
            )
            page.add_table(
                ["what", "at the last check", "standard uncertainty", "unit"],
                [_make_row(reported, j) for j in range(len(reported.values))],
            )
    page.add_heading("All checks")
    page.add_table(
        ["check", "started", "readings", f"residuals, {unit.name} RMS", "statistic", "limit",
         "verdict"],
        [
            [
                check["name"],
                check["started"],
                check["readings"],
                unit.format_value(check["rms_um"] / 1e3),
                f"{check['statistic']:.2f}",
                f"{check['limit']:.2f}",
                LOOK[check["verdict"]][0],
            ]
            for check in checks
        ],
    )  # fmt: skip
    _add_origin(page, judgement, result)
    add_session_facts(page, sessions, arm)
    return page.to_html()


def _add_origin(page: Page, judgement: Judgement, result: dict[str, Any]) -> None:
    """Add the hashes of every check's files, every arm description and every calibration."""
    inputs: dict[str, str] = {}
    for check in judgement.checks:
        name, line = check.line.name, check.line
        for kind, sha256 in (("arm", line.arm_file), ("calibration", line.calibration)):
            if sha256 not in inputs.values():
                inputs[f"{kind} of {name} and later checks"] = sha256
        measured = (file for file in line.files if file in MEASURED)
        inputs |= {f"check {name}, {file}": line.files[file] for file in measured}
    facts = {"arm": result["arm"]} | {
        f"corrected calibration, from {change['from']} on": (
            f"{change['calibration_from']}, SHA-256 {change['calibration_sha256']}"
        )
        for change in result["changes"]
        if change["calibration_from"]
    }
    page.add_origin(make_report_number(result["arm"], *inputs.values()), inputs, facts)


def _write_key_sentence(checks: Sequence[dict[str, Any]], unit: Unit) -> str:
    """Write a sentence with the residual RMS of the last and the first check that are not bad."""
    counts = [check for check in checks if check["verdict"] != "bad_check"] or checks
    last_mm, first_mm = (counts[i]["rms_um"] / 1e3 for i in (-1, 0))
    unit = unit.scale_to(last_mm, first_mm)
    return (
        f"The last check misses the calibration by {unit.to_text(last_mm)} RMS, the first by"
        f" {unit.to_text(first_mm)}."
    )


def _draw_residuals(checks: Sequence[dict[str, Any]], unit: Unit) -> Figure:
    figure, panel = make_single_figure(2.6)
    factor = unit.per_base / 1e3
    draw_by_verdict(panel, checks, [factor * check["rms_um"] for check in checks])
    panel.set_ylabel(f"residuals, {unit.name} RMS")
    panel.set_ylim(bottom=0.0)
    panel.legend(frameon=False)
    return figure


def _draw_over_time(epoch: Epoch, reported: ReportedChange) -> Figure:
    """Draw a cause's amplitudes check by check, and the course that is reported."""
    figure, panel = make_single_figure()
    assert reported.change.cause is not None and reported.cause is not None
    moments = to_instants([check.line.started for check in epoch.checks])
    block = epoch.stack.blocks[reported.change.cause]
    course = compute_shapes(epoch.stack, reported.change)
    grown = course[:, 0] / max(float(course[-1, 0]), 1e-300)
    drawstyle = "default" if reported.change.gradual else "steps-post"
    for j, column in enumerate(reported.cause.candidate.columns):
        unit, factor = SHOWN.get(column.unit, (column.unit, 1.0))
        values, spread = _list_by_check(epoch, block, j)
        colour = COLOURS[j % len(COLOURS)]
        panel.errorbar(
            moments.astype(object), factor * column.prior_sd * values,
            2 * factor * column.prior_sd * spread, fmt="o", markersize=3, elinewidth=0.8,
            color=colour, alpha=0.6, label=f"{column.name}, {unit}, each check alone",
        )  # fmt: skip
        panel.plot(
            moments, factor * reported.values[j] * grown, color=colour, drawstyle=drawstyle,
            label=f"{column.name}, {unit}, as reported",
        )  # fmt: skip
    first, last = (np.datetime64(round(1e6 * s), "us") for s in reported.between_unix_s)
    panel.fill_between(
        np.array([first, last]), 0.0, 1.0, transform=panel.get_xaxis_transform(),
        color="#E69F00", alpha=0.25, linewidth=0, label="the change lies between",
    )  # fmt: skip
    panel.set_xlabel(f"check started, UTC; the change: {format_minute(reported.instant_unix_s)}")
    panel.set_ylabel("amplitude")
    panel.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)
    return figure


def _list_by_check(epoch: Epoch, block: slice, j: int) -> tuple[F64, F64]:
    """Return a column's amplitude (n,) in every check by itself, in typical sizes, and its
    deviation.
    """
    values, spread = [], []
    for residual, columns in zip(epoch.stack.residual, epoch.stack.columns, strict=True):
        block_columns = columns[:, block]
        inverse = np.linalg.pinv(block_columns.T @ block_columns)
        values.append(float(-(inverse @ block_columns.T @ residual)[j]))
        spread.append(float(np.sqrt(inverse[j, j])))
    return np.array(values), np.array(spread)


def _make_row(reported: ReportedChange, j: int) -> list[object]:
    assert reported.cause is not None
    column = reported.cause.candidate.columns[j]
    unit, factor = SHOWN.get(column.unit, (column.unit, 1.0))
    return [
        column.name,
        format_plain(factor * float(reported.values[j]), 3, "+"),
        format_plain(factor * float(reported.deviations[j])),
        unit,
    ]

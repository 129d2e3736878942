"""The HTML page of a history of tables of points: the statistic, and every figure over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from armd.compensation.interim.points.evidence import RUN_LENGTH
from armd.compensation.interim.points.judge import PointEpoch
from armd.compensation.interim.points.result import describe_points
from armd.compensation.report.checks import LOOK, draw_by_verdict, draw_statistics
from armd.compensation.report.layout.about import About
from armd.compensation.report.layout.drawing import COLOURS, make_single_figure
from armd.compensation.report.layout.head import add_head
from armd.compensation.report.layout.page import MOST_SENTENCES, Page, make_report_number
from armd.compensation.wording import format_plain


def render_points_page(
    folder: Path,
    epochs: Sequence[PointEpoch],
    result: dict[str, Any],
    about: About | None = None,
) -> str:
    """Render the report of the history in *folder* as HTML text."""
    page = Page(f"Interim checks of points: {folder.resolve().name}")
    first, *further_sentences = describe_points(epochs)
    changed = result["state"] == "changed"
    reason = page.abbreviate("Verdict", first.removeprefix("In control: "))
    page.add_verdict("CHANGED" if changed else "IN CONTROL", reason, not changed)
    add_head(
        page, None, [], about, [check.first_unix_s for epoch in epochs for check in epoch.checks]
    )
    page.add_items_in_brief("What the checks show", further_sentences, MOST_SENTENCES)
    page.add_text(f"Next: {result['next_check']['sentence']}")
    page.add_text(
        "Decision rule: a change is reported where the statistic reaches its limit: without one,"
        f" once in {RUN_LENGTH:.0f} checks at most. It is Shiryaev's and Roberts's: how much"
        " likelier the figures are with a change than without, over all instants and sizes."
    )
    page.add_figure(draw_statistics(result["checks"]), "The statistic of each check, and its limit")
    page.add_signature_lines("Checked by")
    page.begin_appendix()
    for epoch in epochs:
        _add_changes(page, epoch)
        for j, name in enumerate(epoch.names):
            page.add_figure(
                _draw_over_time(epoch, result["checks"], j), f"{name}, µm, check by check"
            )
    _add_table(page, epochs, result["checks"])
    inputs = {
        f"check {check.name}, {file}": sha256
        for epoch in epochs
        for check in epoch.checks
        for file, sha256 in check.files.items()
    } | {
        f"artefact of {epoch.checks[0].name} and later checks": epoch.checks[0].artefact
        for epoch in epochs
    }
    page.add_origin(make_report_number("points", *inputs.values()), inputs)
    return page.to_html()


def _add_changes(page: Page, epoch: PointEpoch) -> None:
    for number, moved in enumerate(epoch.moved, 1):
        page.add_heading(f"Change {number}: by how much")
        page.add_table(
            ["figure", "before, µm", "change, µm", "standard uncertainty, µm", "95 %, ± µm"],
            [
                [
                    moved_figure.name,
                    format_plain(moved_figure.before_um, 3, "+"),
                    format_plain(moved_figure.change_um, 3, "+"),
                    format_plain(moved_figure.standard_uncertainty_um),
                    format_plain(moved_figure.half_width_um),
                ]
                for moved_figure in moved
            ],
        )


def _draw_over_time(epoch: PointEpoch, checks: Sequence[dict[str, Any]], j: int) -> Figure:
    figure, panel = make_single_figure(2.4)
    name = epoch.names[j]
    artefacts = {check.artefact for check in epoch.checks}
    shown_checks = [c for c in checks if c["artefact"] in artefacts and name in c["figures_um"]]
    draw_by_verdict(panel, shown_checks, [check["figures_um"][name] for check in shown_checks])
    for change in epoch.detected.changes:
        low, high = (np.datetime64(round(1e6 * s), "us") for s in epoch.between_unix_s(change))
        panel.axvspan(low, high, color=COLOURS[4], alpha=0.25, linewidth=0)  # type: ignore[arg-type]
    panel.set_ylabel("µm")
    panel.legend(frameon=False)
    return figure


def _add_table(page: Page, epochs: Sequence[PointEpoch], checks: Sequence[dict[str, Any]]) -> None:
    names = list(dict.fromkeys(name for epoch in epochs for name in epoch.names))
    page.add_heading("All checks")
    page.add_table(
        ["check", "started", *(f"{name}, µm" for name in names), "statistic", "verdict"],
        [
            [
                check["name"],
                check["started"],
                *(
                    format_plain(check["figures_um"][name], 3, "+")
                    if name in check["figures_um"]
                    else ""
                    for name in names
                ),
                f"{check['statistic']:.2f}",
                LOOK[check["verdict"]][0],
            ]
            for check in checks
        ],
    )

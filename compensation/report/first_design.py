"""The poses before the first measurement as one self-contained page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from armd.compensation.design.first import FirstExperiment
from armd.compensation.model.arm import Arm
from armd.compensation.report.design import draw_poses
from armd.compensation.report.layout.page import Page
from armd.compensation.report.sessions import InputFile, add_origin
from armd.terminal.counted import format_count


def make_first_design_report(
    experiment: FirstExperiment,
    arm: Arm,
    rows: Sequence[Mapping[str, Any]],
    words: Sequence[str],
    files: Mapping[str, InputFile | None],
) -> str:
    """Make the page as HTML text.

    *rows* is the table, one mapping per pose, *words* are the sentences that the command prints,
    *files* are arm, calibration and artefact.
    """
    page = Page(f"First experiment with {arm.serial_number}")
    page.add_verdict(f"MEASURE {format_count(len(rows), 'pose').upper()}", words[0], None)
    for sentence in words[1:]:
        page.add_text(sentence)
    page.add_text(
        "Put a target near each tip position, or let a tracker see the tip there, and turn the"
        " joints as shown. All figures are forecasts; nothing is judged by them, so there is no"
        " decision rule."
    )
    figure = draw_poses(experiment.q, experiment.tip_mm, experiment.parameters)
    page.add_figure(figure, "The arm in each pose, joint by joint; its number at the tip")
    page.add_table(list(rows[0]), [[str(value) for value in row.values()] for row in rows])
    add_origin(page, arm, [], files)
    page.add_signature_lines("Planned by", "Checked by")
    return page.to_html()

"""The verification as one HTML page."""

from __future__ import annotations

import plotly.graph_objects as go

from armd.compensation.data.session import Session
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.report.page import Page
from armd.compensation.verify.limits import Limits
from armd.compensation.verify.verdict import Judged, Verdict


def verification_report(
    verdict: Verdict, session: Session, arm: Arm, calibration: LoadedCalibration | None
) -> str:
    """HTML text of the report."""
    page = Page(f"Verification of arm {arm.serial_number}")
    page.text(f"Verdict: {verdict.in_words}.")
    page.text(f"Decision rule: {verdict.rule}.")
    page.table(
        [
            "figure", "standard", "largest, µm", "at", "deciding, µm", "at", "MPE, µm", "U, µm",
            "outcome",
        ],
        [_row(item) for item in verdict.judged],
    )  # fmt: skip
    page.text(
        "Largest: the largest in size. Deciding: nearest its limit or farthest beyond it; limits"
        " and uncertainties may differ from one result to the next, and its own stand beside it."
    )
    untested = [
        f"{key}: {'though it has a limit: ' * (key in verdict.not_tested)}{reason}"
        for key, reason in verdict.verification.left_out.items()
    ]
    if untested:
        page.heading("Not tested")
        page.items(untested)
    if verdict.remarks:
        page.heading("Remarks")
        page.items(verdict.remarks)
    for item in verdict.judged:
        if len(item.figure.deviations) > 3:
            page.heading(f"{item.figure.name}: every result")
            page.figure(_by_length(item, verdict.limits))
    page.heading("What was verified")
    identity = "none: nominal geometry of arm.toml"
    if calibration is not None:
        identity = f"{calibration.path.name}, SHA-256 {calibration.sha256}"
    page.items(
        [
            f"calibration: {identity}",
            f"session: {session.name}, SHA-256 {session.fingerprint()}",
            f"artefact: {session.artefact.name}, {session.n} readings",
        ]
    )
    return page.html()


def _row(item: Judged) -> list[str]:
    return [
        item.figure.name,
        item.figure.standard,
        f"{1e3 * item.figure.worst.value_mm:+.2f}",
        item.figure.worst.where,
        f"{1e3 * item.deciding.value_mm:+.2f}",
        item.deciding.where,
        "" if item.limit_mm is None else f"{1e3 * item.limit_mm:.2f}",
        f"{1e3 * item.expanded_uncertainty_mm:.2f}",
        item.outcome,
    ]


def _by_length(item: Judged, limits: Limits | None) -> go.Figure:
    deviations = item.figure.deviations
    lengths = [deviation.length_mm for deviation in deviations]
    figure = go.Figure(
        go.Scatter(
            name="result",
            x=lengths,
            y=[1e3 * deviation.value_mm for deviation in deviations],
            text=[deviation.where for deviation in deviations],
            mode="markers",
        )
    )
    if limits is not None and item.limit_mm is not None:
        ends = [min(lengths), max(lengths)]
        for sign in (-1, 1):
            limit = [sign * 1e3 * (limits.mpe.of(item.figure.key, at) or 0.0) for at in ends]
            figure.add_scatter(x=ends, y=limit, name="MPE", mode="lines", line_dash="dash")
    return figure.update_layout(xaxis_title="length, mm", yaxis_title="error, µm", showlegend=False)

"""The verification as one HTML page."""

from __future__ import annotations

import plotly.graph_objects as go

from armd.compensation.arm import Arm
from armd.compensation.calibration import LoadedCalibration
from armd.compensation.report.page import Page
from armd.compensation.session import Session
from armd.compensation.verify.verdict import Judged, Verdict


def verification_report(
    verdict: Verdict, session: Session, arm: Arm, calibration: LoadedCalibration | None
) -> str:
    """HTML text of the report."""
    page = Page(f"Verification of arm {arm.serial_number}")
    if verdict.limits is not None:
        page.text("PASSED" if verdict.passed else "FAILED")
    page.text(f"Decision rule: {verdict.rule}.")
    page.table(
        ["figure", "standard", "deciding value, µm", "at", "MPE, µm", "U, µm", "outcome"],
        [_row(item) for item in verdict.judged],
    )
    untested = [f"{key}: {reason}" for key, reason in verdict.verification.left_out.items()]
    if untested:
        page.heading("Not tested")
        page.items(untested)
    if verdict.remarks:
        page.heading("Remarks")
        page.items(verdict.remarks)
    for item in verdict.judged:
        if len(item.figure.deviations) > 3:
            page.heading(f"{item.figure.name}: every result")
            page.figure(_by_length(item))
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
        f"{1e3 * item.deciding.value_mm:.2f}",
        item.deciding.where,
        "" if item.limit_mm is None else f"{1e3 * item.limit_mm:.2f}",
        f"{1e3 * item.expanded_uncertainty_mm:.2f}",
        item.outcome,
    ]


def _by_length(item: Judged) -> go.Figure:
    deviations = item.figure.deviations
    figure = go.Figure(
        go.Scatter(
            x=[deviation.length_mm for deviation in deviations],
            y=[1e3 * deviation.value_mm for deviation in deviations],
            text=[deviation.where for deviation in deviations],
            mode="markers",
        )
    )
    if item.limit_mm is not None:
        for sign in (-1, 1):
            figure.add_hline(y=sign * 1e3 * item.limit_mm, line_dash="dash")
    return figure.update_layout(xaxis_title="length, mm", yaxis_title="error, µm")

"""A history of checks as one HTML page: the statistic, the residuals, and each change over time."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go

from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import ARC_SECOND, plain
from armd.compensation.interim.changes import shapes
from armd.compensation.interim.evidence import RUN_LENGTH
from armd.compensation.interim.judge import Epoch, Judgement, Told
from armd.compensation.interim.result import in_words, minute
from armd.compensation.report.page import Page

F64 = npt.NDArray[np.float64]

#: How a verdict looks; colours are told apart by colour-blind readers too.
LOOK = {
    "in_control": ("in control", "#009E73", "circle"),
    "changed": ("changed", "#D55E00", "diamond"),
    "bad_check": ("bad check", "#000000", "x"),
}
#: Units as a person reads them: the name, and how many of them one unit of the model is.
SHOWN = {"rad": ("″", 1 / ARC_SECOND), "mm": ("µm", 1e3), "rad/Nm": ("µrad/Nm", 1e6)}


def interim_page(judgement: Judgement, result: dict[str, Any]) -> str:
    """HTML text of the report."""
    page = Page(f"Interim checks of arm {result['arm']}")
    page.items(in_words(judgement))
    if result["next_check"]:
        page.text(f"Next: {result['next_check']['sentence']}")
    page.heading("Checks")
    page.text(
        "A change is told where the statistic reaches its limit: without one, once in "
        f"{RUN_LENGTH:.0f} checks on average or less often. It is Shiryaev's and Roberts's: how "
        "much likelier the readings are with a change than without, over all instants and causes."
    )
    checks = result["checks"]
    page.figure(_statistics(checks))
    page.figure(_residuals(checks))
    for epoch in judgement.epochs:
        for told in epoch.told:
            if told.cause is None:
                continue
            candidate = told.cause.candidate
            page.heading(f"{candidate.cause.replace('_', ' ')}, {candidate.location}")
            page.text(f"{CATALOGUE[candidate.cause].reason}.".capitalize())
            page.figure(_over_time(epoch, told))
            page.table(
                ["what", "at the last check", "standard uncertainty", "unit"],
                [_row(told, j) for j in range(len(told.values))],
            )
    page.heading("All checks")
    page.table(
        ["check", "started", "readings", "residuals, µm RMS", "statistic", "limit", "verdict"],
        [
            [
                check["name"],
                check["started"],
                check["readings"],
                plain(check["rms_um"]),
                f"{check['statistic']:.2f}",
                f"{check['limit']:.2f}",
                LOOK[check["verdict"]][0],
            ]
            for check in checks
        ],
    )
    page.heading("What was judged")
    page.items(
        [
            f"calibration of the last check: SHA-256 {result['calibration']}",
            *(
                f"mended calibration, from {change['from']} on: {change['calibration_from']}"
                for change in result["changes"]
                if change["calibration_from"]
            ),
        ]
    )
    return page.html()


def _instants(texts: Sequence[str]) -> list[datetime.datetime]:
    return [datetime.datetime.fromisoformat(text) for text in texts]


def _statistics(checks: Sequence[dict[str, Any]]) -> go.Figure:
    figure = go.Figure()
    for verdict, (name, colour, symbol) in LOOK.items():
        own = [check for check in checks if check["verdict"] == verdict]
        # Beyond its limit a statistic grows with every check: what matters is where it passes.
        figure.add_scatter(
            x=_instants([check["started"] for check in own]),
            y=[min(check["statistic"], 4 * check["limit"]) for check in own],
            mode="markers",
            name=name,
            marker={"color": colour, "symbol": symbol, "size": 8},
        )
    figure.add_hline(checks[0]["limit"], line_dash="dash", annotation_text="limit")
    figure.update_xaxes(title="check started, UTC")
    figure.update_yaxes(title="statistic (natural logarithm; cut at 4 limits)")
    return figure


def _residuals(checks: Sequence[dict[str, Any]]) -> go.Figure:
    figure = go.Figure()
    for verdict, (name, colour, symbol) in LOOK.items():
        own = [check for check in checks if check["verdict"] == verdict]
        figure.add_scatter(
            x=_instants([check["started"] for check in own]),
            y=[check["rms_um"] for check in own],
            mode="markers",
            name=name,
            marker={"color": colour, "symbol": symbol, "size": 8},
        )
    figure.update_xaxes(title="check started, UTC")
    figure.update_yaxes(title="residuals under the calibration, µm RMS", rangemode="tozero")
    return figure


def _over_time(epoch: Epoch, told: Told) -> go.Figure:
    """A cause's amplitudes check by check, and the course that is told."""
    figure = go.Figure()
    assert told.change.cause is not None and told.cause is not None
    instants = _instants([check.line.started for check in epoch.checks])
    block = epoch.stack.blocks[told.change.cause]
    course = shapes(epoch.stack, told.change)
    grown = course[:, 0] / max(float(course[-1, 0]), 1e-300)
    for j, column in enumerate(told.cause.candidate.columns):
        unit, factor = SHOWN.get(column.unit, (column.unit, 1.0))
        values, spread = _by_check(epoch, block, j)
        figure.add_scatter(
            x=instants,
            y=factor * column.typical * values,
            error_y={"type": "data", "array": 2 * factor * column.typical * spread},
            mode="markers",
            name=f"{column.name}, {unit}, each check alone",
        )
        figure.add_scatter(
            x=instants,
            y=factor * told.values[j] * grown,
            mode="lines",
            line_shape="linear" if told.change.gradual else "hv",
            name=f"{column.name}, {unit}, as told",
        )
    figure.add_vrect(
        x0=datetime.datetime.fromtimestamp(told.between_unix_s[0], datetime.UTC),
        x1=datetime.datetime.fromtimestamp(told.between_unix_s[1], datetime.UTC),
        fillcolor="#E69F00",
        opacity=0.25,
        line_width=0,
        annotation_text="between",
    )
    figure.update_xaxes(title=f"check started, UTC; the change: {minute(told.instant_unix_s)}")
    figure.update_yaxes(title="amplitude (bars: two standard uncertainties)")
    return figure


def _by_check(epoch: Epoch, block: slice, j: int) -> tuple[F64, F64]:
    """(n,) a column's amplitude in every check alone, in typical sizes, and its deviation."""
    values, spread = [], []
    for residual, columns in zip(epoch.stack.residual, epoch.stack.columns, strict=True):
        own = columns[:, block]
        inverse = np.linalg.pinv(own.T @ own)
        values.append(float(-(inverse @ own.T @ residual)[j]))
        spread.append(float(np.sqrt(inverse[j, j])))
    return np.array(values), np.array(spread)


def _row(told: Told, j: int) -> list[object]:
    assert told.cause is not None
    column = told.cause.candidate.columns[j]
    unit, factor = SHOWN.get(column.unit, (column.unit, 1.0))
    return [
        column.name,
        plain(factor * float(told.values[j]), 3, "+"),
        plain(factor * float(told.deviations[j])),
        unit,
    ]

"""Drawings of checks over time: each check by its verdict, and the statistic with its limit."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from armd.compensation.report.layout.drawing import make_single_figure

#: The name, colour and marker of each verdict; colour-blind readers can separate the colours.
LOOK = {
    "in_control": ("in control", "#009E73", "o"),
    "changed": ("changed", "#D55E00", "D"),
    "bad_check": ("bad check", "#000000", "x"),
}


def to_instants(texts: Sequence[str]) -> npt.NDArray[np.datetime64]:
    """Convert instants to UTC in the form that a drawing needs."""
    utc = [datetime.datetime.fromisoformat(text).astimezone(datetime.UTC) for text in texts]
    return np.array([instant.replace(tzinfo=None) for instant in utc], dtype="datetime64[us]")


def draw_by_verdict(panel: Axes, checks: Sequence[dict[str, Any]], values: Sequence[float]) -> None:
    """Draw a mark for each check that shows its verdict."""
    for verdict, (name, colour, mark) in LOOK.items():
        indices = [i for i, check in enumerate(checks) if check["verdict"] == verdict]
        panel.plot(
            to_instants([checks[i]["started"] for i in indices]),
            [values[i] for i in indices],
            mark,
            color=colour,
            markersize=4,
            label=name,
        )
    panel.set_xlabel("check started, UTC")


def draw_statistics(checks: Sequence[dict[str, Any]]) -> Figure:
    figure, panel = make_single_figure(2.8)
    # Above its limit a statistic grows with every check; only the crossing is of interest.
    draw_by_verdict(panel, checks, [min(c["statistic"], 4 * c["limit"]) for c in checks])
    panel.axhline(checks[0]["limit"], linestyle="--", color="black", label="limit")
    panel.set_ylabel("log statistic (cut at 4 limits)")
    panel.legend(frameon=False)
    return figure

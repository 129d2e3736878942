"""Drawings of checks over time: each by its verdict, and the statistic with its limit."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from armd.compensation.report.layout.drawing import make_single_figure

#: How a verdict looks; colours are told apart by colour-blind readers too.
LOOK = {
    "in_control": ("in control", "#009E73", "o"),
    "changed": ("changed", "#D55E00", "D"),
    "bad_check": ("bad check", "#000000", "x"),
}


def to_instants(texts: Sequence[str]) -> npt.NDArray[np.datetime64]:
    """Instants in UTC, as a drawing takes them."""
    utc = [datetime.datetime.fromisoformat(text).astimezone(datetime.UTC) for text in texts]
    return np.array([instant.replace(tzinfo=None) for instant in utc], dtype="datetime64[us]")


def draw_by_verdict(panel: Axes, checks: Sequence[dict[str, Any]], values: Sequence[float]) -> None:
    """A mark for each check, that shows its verdict."""
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
    # Beyond its limit a statistic grows with every check: what matters is where it passes.
    draw_by_verdict(panel, checks, [min(c["statistic"], 4 * c["limit"]) for c in checks])
    panel.axhline(checks[0]["limit"], linestyle="--", color="black", label="limit")
    panel.set_ylabel("log statistic (cut at 4 limits)")
    panel.legend(frameon=False)
    return figure

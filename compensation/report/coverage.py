"""A picture of the measured range: the artefact's placements around the arm, and the joints'
ranges.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes

from armd.arrays import F64
from armd.compensation.data.sessions.session import Session, make_distinct_names
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.report.layout.drawing import COLOURS, MOST_POINTS, make_figure
from armd.compensation.report.layout.page import Page

#: With more placements than this a colour scale without names is used.
MOST_NAMED = 8
GREY = "#8c959f"
HEIGHT_IN = 2.6


def add_coverage(page: Page, arm: Arm, sessions: Sequence[Session]) -> None:
    """Add the picture, unless the joints' angles are not known (a table of points)."""
    with_angles = [session for session in sessions if session.n and np.ptp(session.states.q) > 0.0]
    if not with_angles:
        return
    figure, panels = make_figure(1, 3, HEIGHT_IN)
    names, places = _group_places(arm, with_angles)
    for panel, up, title in ((panels[0], 1, "from above"), (panels[1], 2, "from the side")):
        _draw_places(panel, places, names, up)
        panel.set_title(title)
    handles, labels = panels[0].get_legend_handles_labels()
    if len(names) <= MOST_NAMED:
        figure.legend(handles, labels, loc="outside lower left", ncols=4, frameon=False)
    _draw_joints(panels[2], arm, np.vstack([session.states.q for session in with_angles]))
    page.add_figure(
        figure,
        "Where it was measured: the tip as arm.toml places it, a colour for each place of the"
        " artefact; the range of each joint that was used (blue) of what it has (grey)",
    )


def _group_places(arm: Arm, sessions: Sequence[Session]) -> tuple[list[str], list[F64]]:
    """List the names of the artefact's placements, and the tip's positions (n, 3) mm at each."""
    names, places = [], []
    for session, of_session in zip(sessions, make_distinct_names(sessions), strict=True):
        tip = compute_pose(session.states.q, arm.nominal())[0]
        for i, name in enumerate(session.placement_names):
            rows = np.flatnonzero((session.placement == i) & np.isfinite(tip[:, 0]))
            if rows.size:
                names.append(f"{of_session}, {name}" if len(sessions) > 1 else name)
                few = min(len(rows), max(MOST_POINTS // 50, 1))
                places.append(tip[rows[np.linspace(0, len(rows) - 1, few).astype(int)]])
    return names, places


def _draw_places(panel: Axes, places: Sequence[F64], names: Sequence[str], up: int) -> None:
    few = len(places) <= MOST_NAMED
    shades = colormaps["viridis"](np.linspace(0.0, 0.95, len(places)))
    for i, (tip, name) in enumerate(zip(places, names, strict=True)):
        colour = COLOURS[i % len(COLOURS)] if few else shades[i]
        panel.plot(
            tip[:, 0], tip[:, up], ".", color=colour, markersize=4, label=name, rasterized=True
        )
    panel.plot(0.0, 0.0, "s", color="black", markersize=6)
    panel.annotate("base", (0.0, 0.0), xytext=(5, 5), textcoords="offset points")
    panel.set_aspect("equal", adjustable="datalim")
    panel.set(xlabel="x, mm", ylabel=f"{'xyz'[up]}, mm")


def _draw_joints(panel: Axes, arm: Arm, q: F64) -> None:
    low, high = (np.degrees(limit) for limit in arm.range_rad)
    for k in range(arm.n_joints):
        used = np.degrees(q[np.isfinite(q[:, k]), k])
        panel.plot([low[k], high[k]], [k + 1, k + 1], color=GREY, linewidth=1.5, alpha=0.6)
        panel.plot(
            used, np.full(len(used), k + 1), "|", color=COLOURS[0], markersize=7, alpha=0.5,
            rasterized=True,
        )  # fmt: skip
        share = np.ptp(used) / (high[k] - low[k]) if used.size else 0.0
        panel.annotate(
            f"{100 * share:.0f} %", (1.0, k + 1), xycoords=("axes fraction", "data"),
            xytext=(2, 0), textcoords="offset points", va="center",
        )  # fmt: skip
    panel.set_yticks(range(1, arm.n_joints + 1))
    panel.invert_yaxis()
    panel.set_title("joints' ranges")
    panel.set(xlabel="angle, °", ylabel="joint")

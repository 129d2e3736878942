"""The next experiment as one self-contained page: a picture of the poses, and their table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from armd.arrays import F64
from armd.compensation.data.sessions.session import Session
from armd.compensation.design.design import Experiment
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_frames
from armd.compensation.report.layout.drawing import make_views, set_view
from armd.compensation.report.layout.page import Page
from armd.compensation.report.sessions import InputFile, add_origin
from armd.terminal.counted import format_count


def make_design_report(
    experiment: Experiment,
    arm: Arm,
    sessions: Sequence[Session],
    rows: Sequence[Mapping[str, Any]],
    files: Mapping[str, InputFile | None],
) -> str:
    """Make the page as HTML text.

    *sessions* are the existing ones, *rows* is the table, one mapping per pose, *files* are arm and
    calibration.
    """
    page = Page(f"Next experiment with {arm.serial_number}")
    criterion = experiment.criterion
    page.add_verdict(
        f"MEASURE {format_count(len(rows), 'pose').upper()}",
        f"To {criterion.words}: {experiment.climate.words}.",
        None,
    )
    with_these = "this pose" if len(rows) == 1 else f"these {len(rows)} poses"
    page.add_text(
        f"{criterion.quantity[:1].upper()}{criterion.quantity[1:]}: "
        f"{experiment.before:.2f} {criterion.unit} with the sessions there are, "
        f"{experiment.after:.2f} with {with_these} on one new placement of "
        "the artefact too. Put a target near each tip position, turn the joints as shown, and come "
        "to rest from the side given. Both figures are forecasts; nothing is judged by them, so"
        " there is no decision rule."
    )
    picture = draw_poses(experiment.states.q, experiment.tip_mm, experiment.parameters)
    page.add_figure(picture, "The arm in each pose, joint by joint; its number at the tip")
    narrow = [_narrow_row(row) for row in rows]
    page.add_table(list(narrow[0]), [list(row.values()) for row in narrow])
    add_origin(page, arm, sessions, files)
    page.add_signature_lines("Planned by", "Checked by")
    return page.to_html()


def _narrow_row(row: Mapping[str, Any]) -> dict[str, str]:
    """Return a pose as a row with one column for all approaches and one for all temperatures."""
    sides = "".join(side for name, side in row.items() if name.startswith("approach_joint"))
    warm = " ".join(f"{value:g}" for name, value in row.items() if name.endswith("_c"))
    place = {n: str(v) for n, v in row.items() if n.endswith(("pose", "_mm", "_deg"))}
    return place | {"turn last towards": sides, "sensors, °C": warm}


def draw_poses(q: F64, tip_mm: F64, parameters: F64, ax: Axes | None = None) -> Figure:
    """Draw the arm in every pose (n, N) rad, from the base to *tip_mm* (n, 3), in the base frame.

    The views are from above and from the side; on *ax* from the side, or in space if it has three
    dimensions.
    """
    chains = np.concatenate([compute_frames(q, parameters)[0], tip_mm[:, None]], axis=1)
    if ax is None:
        figure, panels = make_views()
        for panel, across, up in panels:
            _draw_chains(panel, chains[:, :, [across, up]])
        return figure
    parent_figure = ax.get_figure(root=True)
    assert parent_figure is not None
    if ax.name == "3d":
        _draw_chains(ax, chains)
        for axis in "xyz":
            getattr(ax, f"set_{axis}label")(f"{axis}, mm")
        ax.set_aspect("equal")
    else:
        set_view(ax, 0, 2)
        _draw_chains(ax, chains[:, :, [0, 2]])
    return parent_figure


def _draw_chains(panel: Axes, chains: F64) -> None:
    """Draw arms (n, K, 2) or (n, K, 3) mm as lines from base to tip, with their numbers at
    the tip.
    """
    for i, chain in enumerate(chains, 1):
        panel.plot(*chain.T, marker="o", markersize=2.5, linewidth=1.0)
        panel.text(*chain[-1], str(i), weight="bold")  # type: ignore[call-arg]

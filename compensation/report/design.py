"""The next experiment as one self-contained page: a picture of the poses, and their table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from armd.compensation.design.design import Experiment
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import frames
from armd.compensation.report.page import Page


def design_report(experiment: Experiment, arm: Arm, rows: Sequence[Mapping[str, Any]]) -> str:
    """The page; *rows* is the table, one mapping per pose."""
    page = Page(f"Next experiment with {arm.serial_number}")
    criterion = experiment.criterion
    page.text(
        f"To {criterion.words}: {experiment.climate.words}. {criterion.quantity.capitalize()}: "
        f"{experiment.before:.2f} {criterion.unit} with the sessions there are, "
        f"{experiment.after:.2f} with these {len(rows)} poses on one new placement of the "
        "artefact too. Put a target near each tip position, turn the joints as shown, and come "
        "to rest from the side given."
    )
    page.figure(_picture(experiment), height=620)
    narrow = [_narrow(row) for row in rows]
    page.table(list(narrow[0]), [list(row.values()) for row in narrow])
    return page.html()


def _narrow(row: Mapping[str, Any]) -> dict[str, str]:
    """A pose as a line of a page: sides of approach and temperatures in a column each."""
    sides = "".join(side for name, side in row.items() if name.startswith("approach_joint"))
    warm = " ".join(f"{value:g}" for name, value in row.items() if name.endswith("_c"))
    place = {n: str(v) for n, v in row.items() if n.endswith(("pose", "_mm", "_deg"))}
    return place | {"turn last towards": sides, "sensors, °C": warm}


def _picture(experiment: Experiment) -> go.Figure:
    """The arm in every pose, base to tip, in mm of the base frame."""
    origins = frames(experiment.states.q, experiment.parameters)[0]
    figure = go.Figure()
    for i, (joints, tip) in enumerate(zip(origins, experiment.tip_mm, strict=True), 1):
        x, y, z = np.vstack([joints, tip]).T
        figure.add_scatter3d(
            x=x, y=y, z=z, mode="lines+markers+text", name=f"pose {i}", marker={"size": 3},
            text=[""] * len(joints) + [str(i)],
        )  # fmt: skip
    figure.update_scenes(
        xaxis_title="x, mm", yaxis_title="y, mm", zaxis_title="z, mm", aspectmode="data"
    )
    return figure

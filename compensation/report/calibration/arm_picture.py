"""A picture of the arm as it is modelled: its links, its frames, and the parameters of
each frame.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_frames, compute_pose
from armd.compensation.model.parameters import JOINT_PARAMETERS, TIP_PARAMETERS
from armd.compensation.report.layout.drawing import COLOURS, make_single_figure

HEIGHT_IN = 4.4
#: The length of a frame's axes, as a share of the arm's reach.
AXIS_SHARE = 0.09
#: The colours of a frame's x, y and z axes.
AXES = (COLOURS[1], COLOURS[2], COLOURS[0])
#: The direction of view: the arm's x to the lower right, y into the page, z upwards.
VIEW_TURN, VIEW_TILT = np.radians(-60.0), np.radians(25.0)
LETTERS = {"theta": "θ", "d": "d", "a": "a", "alpha": "α", "beta": "β"}


def draw_arm_picture(arm: Arm, q: F64, constants: Collection[str]) -> Figure:
    """Draw the arm of arm.toml in the posture *q* (N,) rad, labelled with the *constants* named."""
    origins, rotations = (part[0] for part in compute_frames(q[None], arm.nominal()))
    tip = compute_pose(q[None], arm.nominal())[0][0]
    figure, panel = make_single_figure(HEIGHT_IN)
    chain = _project(np.vstack([origins, tip]))
    panel.plot(*chain.T, color="#57606a", linewidth=3.0, alpha=0.5, zorder=1)
    panel.plot(*chain[-1], "o", color="black", markersize=5)
    length = AXIS_SHARE * arm.reach_mm
    for origin, rotation in zip(origins, rotations, strict=True):
        for column, colour in enumerate(AXES):
            line = _project(np.vstack([origin, origin + length * rotation[:, column]]))
            panel.plot(*line.T, color=colour, linewidth=1.4)
    labels = [_label_frame(k, constants) for k in range(arm.n_joints + 1)]
    labels.append(_name_quantity("tip", [name for name in TIP_PARAMETERS if name in constants]))
    _put_labels(panel, chain, labels)
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_axis_off()
    return figure


def _project(points: F64) -> F64:
    """Project points (n, 3) onto the paper (n, 2), mm."""
    x, y, z = points.T
    across = x * np.cos(VIEW_TURN) - y * np.sin(VIEW_TURN)
    depth = x * np.sin(VIEW_TURN) + y * np.cos(VIEW_TURN)
    return np.column_stack([across, z * np.cos(VIEW_TILT) + depth * np.sin(VIEW_TILT)])


def _label_frame(k: int, constants: Collection[str]) -> str:
    """Label frame *k* with the parameters of the joint that leads to it."""
    if k == 0:
        return "base"
    names = [
        LETTERS[parameter] + str(k)
        for parameter in JOINT_PARAMETERS
        if f"{parameter}_{k}" in constants
    ]
    return _name_quantity(f"frame {k}", names)


def _name_quantity(quantity: str, names: list[str]) -> str:
    return f"{quantity}: {' '.join(names)}" if names else quantity


def _put_labels(panel: Axes, place_mm: F64, labels: list[str]) -> None:
    """Put labels in two columns beside the arm by height, each with a thin line to its frame."""
    middle = float(np.median(place_mm[:, 0]))
    order = np.argsort(place_mm[:, 0] - middle, kind="stable")
    sides = {"left": order[: len(order) // 2], "right": order[len(order) // 2 :]}
    for side, chosen in sides.items():
        by_height = chosen[np.argsort(-place_mm[chosen, 1], kind="stable")]
        for place, i in enumerate(by_height):
            panel.annotate(
                labels[i], place_mm[i],
                xytext=(0.02 if side == "left" else 0.98, 0.95 - 0.9 * place / max(len(chosen), 1)),
                textcoords="axes fraction", ha=side, va="center",
                arrowprops={"arrowstyle": "-", "color": "#8c959f", "linewidth": 0.7},
            )  # fmt: skip

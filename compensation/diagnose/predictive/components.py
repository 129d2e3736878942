"""Components along which residuals are compared: joints, links, stylus, base and artefact.

The effect of a joint shows along its motion. The effect of a link's bending or expansion shows
along its lean or length. The effect of a wrong artefact shows in the artefact's frame; over no
joint's angle would it make a clear curve.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import SHORTEST_MM
from armd.compensation.diagnose.problem.linear import Linear
from armd.compensation.effects.effect import ArtefactChange
from armd.compensation.estimate.surfaces import project_on_normals
from armd.compensation.model.parameters import BASE_PARAMETERS, TIP_PARAMETERS


@dataclass(frozen=True)
class Component:
    """One direction of residuals in the predictive curves."""

    name: str  # as in `predictive`
    quantity: Literal["angle", "length", "scale"]  # in rad, mm, and without a unit
    place: str  # as in a finding's location

    @property
    def title(self) -> str:
        """The label of a plot's axis."""
        return self.name.removeprefix("angle ").replace("scale", "scale of")


def make_components(linear: Linear) -> tuple[list[Component], F64]:
    """Return every component, and the tip's motion (n, 3, K) in mm per unit of each."""
    named = [
        *_make_angles(linear),
        *_make_leans(linear),
        *_make_lengths(linear),
        *_make_base_components(linear),
        *_make_artefact_components(linear),
    ]
    return [component for component, _ in named], np.stack([moves for _, moves in named], axis=2)


def _make_angles(linear: Linear) -> list[tuple[Component, F64]]:
    return [
        (Component(f"angle joint {k + 1}", "angle", f"joint {k + 1}"), linear.joints[:, :, k])
        for k in range(linear.joints.shape[2])
    ]


def _make_leans(linear: Linear) -> list[tuple[Component, F64]]:
    """Make two leans of each link but the last, about the two axes across its joint's.

    A lean of the last link is the same as a shift of the stylus.
    """
    layout = linear.rests.observations.arm.layout
    return [
        (
            Component(f"lean {axis} link {k}", "angle", f"link {k}"),
            linear.jacobian[layout.index(f"{parameter}_{k}")][: 3 * linear.rests.n].reshape(-1, 3),
        )
        for k in range(1, linear.joints.shape[2])
        for axis, parameter in (("x", "alpha"), ("y", "beta"))
    ]


def _make_lengths(linear: Linear) -> list[tuple[Component, F64]]:
    """Make a component for each link that has a length, and for the stylus.

    The drawing decides, not a fit: fits to the same readings have the same components.
    """
    arm = linear.rests.observations.arm
    layout, drawn_mm = arm.layout, arm.nominal()
    bodies = [
        (f"link {k + 1}", f"link {k + 1}", layout.indices([f"d_{k + 1}", f"a_{k + 1}"]))
        for k in range(linear.joints.shape[2])
    ]
    bodies.append(("stylus", "tip", layout.indices(TIP_PARAMETERS)))
    components = []
    for name, place, parameters in bodies:
        parts_mm = linear.model.constants[parameters]
        if np.linalg.norm(drawn_mm[parameters]) >= SHORTEST_MM:
            length_mm = max(float(np.linalg.norm(parts_mm)), SHORTEST_MM)
            column = parts_mm / length_mm @ linear.jacobian[parameters]
            moves = column[: 3 * linear.rests.n].reshape(-1, 3)
            components.append((Component(f"length {name}", "length", place), moves))
    return components


def _make_base_components(linear: Linear) -> list[tuple[Component, F64]]:
    layout = linear.rests.observations.arm.layout
    return [
        (Component(f"{axis} base", "length", "base"), column[: 3 * linear.rests.n].reshape(-1, 3))
        for axis, column in (
            (name[-1], linear.jacobian[layout.index(name)]) for name in BASE_PARAMETERS[:3]
        )
    ]


def _make_artefact_components(linear: Linear) -> list[tuple[Component, F64]]:
    rests = linear.rests
    scale = linear.artefact_column(ArtefactChange("scale"))[: 3 * rests.n].reshape(-1, 3)
    axes = linear.poses.rotation[rests.observations.placement]  # its columns, in the base frame
    if linear.normal is not None:
        axes = project_on_normals(linear.normal, axes)
    components = [(Component("scale artefact", "scale", "artefact"), scale)]
    return components + [
        (Component(f"{axis} artefact", "length", "artefact"), axes[:, :, i])
        for i, axis in enumerate("xyz")
    ]

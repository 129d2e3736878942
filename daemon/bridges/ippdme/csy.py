"""Coordinate systems: a chain of rigid transformations, kept over restarts.

machine → MultipleArmCsy → MoveableMachineCsy → PartCsy. Each is p' = R (p − p0) with
R = Rφ·Rθ·Rψ about z, x', z'' (1.4.3, 6.3.3 and A.4.2).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from armd.arrays import F64
from armd.daemon.bridges.ippdme.errors import DmeError
from armd.errors import BadInput
from armd.files.schema import Strict, load_json
from armd.files.state_folder import find_state_folder
from armd.files.writing import write_whole

MACHINE = "MachineCsy"
#: A kilometre: no part is further from its machine.
MOST_MM = 1e6
#: From the machine outwards; a selected one includes all before it.
CHAIN = ("MultipleArmCsy", "MoveableMachineCsy", "PartCsy")
#: They can be set and read, but not selected.
OTHERS = ("JogDisplayCsy", "JogMoveCsy", "SensorCsy")


class Transformation(NamedTuple):
    """A rigid transformation as the standard writes it.

    The origin of the child in its parent is in mm, angles are in degrees.
    """

    x0: float = 0.0
    y0: float = 0.0
    z0: float = 0.0
    theta: float = 0.0
    psi: float = 0.0
    phi: float = 0.0

    def rotation(self) -> F64:
        """Return R (3, 3) of p' = R (p − p0)."""
        angles = np.radians([self.theta, self.psi, self.phi])
        (c1, c2, c3), (s1, s2, s3) = np.cos(angles), np.sin(angles)
        return np.array(
            [
                [c2 * c3 - c1 * s2 * s3, s2 * c3 + c1 * c2 * s3, s1 * s3],
                [-c2 * s3 - c1 * s2 * c3, -s2 * s3 + c1 * c2 * c3, s1 * c3],
                [s1 * s2, -s1 * c2, c1],
            ]
        )

    @property
    def origin(self) -> F64:
        return np.array([self.x0, self.y0, self.z0])

    def checked(self) -> Transformation:
        """Return this with Psi and Phi within one turn.

        Raises `DmeError` for a Theta outside 0 to 180°, and for an origin so far away that a double
        has no digits left for positions.
        """
        if not 0.0 <= self.theta <= 180.0:
            raise DmeError(1007)
        if max(map(abs, (self.x0, self.y0, self.z0))) > MOST_MM:
            raise DmeError(509)
        return self._replace(psi=self.psi % 360.0, phi=self.phi % 360.0)


Selectable = Literal["MachineCsy", "MultipleArmCsy", "MoveableMachineCsy", "PartCsy"]
Six = Annotated[tuple[float, ...], Field(min_length=6, max_length=6)]


class Saved(Strict):
    """The content of the file that keeps the settings over a restart."""

    schema_: Literal["armd.ippdme/1"] = Field(alias="schema")
    selected: Selectable = "MachineCsy"
    transformations: dict[str, Six] = {}
    named: dict[str, Six] = {}


def locate_state_file(serial: str) -> Path:
    """Return the path of the state file of the arm that is served."""
    return find_state_folder() / f"ippdme-{serial}.json"


class CoordinateSystems:
    """The client's settings, written to disk before the client gets an answer."""

    def __init__(self, path: Path) -> None:
        """Load the settings; rename a damaged file and start without any.

        Neither what a host has sent nor a crash may prevent a start. `lost` then describes the loss
        until a host has been told: it must not continue to measure in a coordinate system that is
        gone.
        """
        self._path = path
        self.lost: str | None = None
        saved = Saved(schema="armd.ippdme/1")
        if path.exists():
            try:
                saved = load_json(path, Saved)
            except BadInput as error:
                aside = path.with_name(f"{path.name}.damaged")
                path.replace(aside)
                self.lost = f"{error}; set aside as {aside}, no coordinate system is set"
        self.selected: str = saved.selected
        self._transformations = {k: Transformation(*v) for k, v in saved.transformations.items()}
        self.named = {k: Transformation(*v) for k, v in saved.named.items()}
        self._compose()

    def select(self, name: str) -> None:
        """Select a system; raises `DmeError` for an unknown or unselectable name."""
        if name in OTHERS:
            raise DmeError(506)
        if name != MACHINE and name not in CHAIN:
            raise DmeError(505)
        self._change(selected=name)

    def get(self, name: str) -> Transformation:
        if name not in CHAIN + OTHERS:
            raise DmeError(505)
        return self._transformations.get(name, Transformation())

    def set(self, name: str, transformation: Transformation) -> None:
        """Set a transformation; raises `DmeError` for an unknown name or an invalid angle."""
        self.get(name)
        changed = {**self._transformations, name: transformation.checked()}
        self._change(transformations=changed)

    def save_named(self, name: str, transformation: Transformation) -> None:
        self._change(named={**self.named, name: transformation.checked()})

    def delete_named(self, name: str) -> None:
        """Delete a named transformation; raises `DmeError` for an unknown name."""
        self.find_named(name)
        self._change(named={k: v for k, v in self.named.items() if k != name})

    def find_named(self, name: str) -> Transformation:
        if name not in self.named:
            raise DmeError(1013)
        return self.named[name]

    def position(self, base_mm: F64) -> F64:
        """Convert a point (3,) of the base frame to the selected coordinate system, mm."""
        position: F64 = self._rotation @ base_mm + self._shift
        return position

    def direction(self, base: F64) -> F64:
        """Convert a vector (3,) of the base frame to the selected coordinate system."""
        direction: F64 = self._rotation @ base
        return direction

    def _change(
        self,
        selected: str | None = None,
        transformations: dict[str, Transformation] | None = None,
        named: dict[str, Transformation] | None = None,
    ) -> None:
        """Write the new settings to disk, then use them.

        Raises `DmeError` and changes nothing if writing fails.
        """
        selected = selected or self.selected
        transformations = self._transformations if transformations is None else transformations
        named = self.named if named is None else named
        content = {
            "schema": "armd.ippdme/1",
            "selected": selected,
            "transformations": transformations,
            "named": named,
        }
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self._path, json.dumps(content, indent=1))
        except OSError as error:
            raise DmeError(511) from error
        self.selected, self._transformations, self.named = selected, transformations, named
        self._compose()

    def _compose(self) -> None:
        """Compute the transformation from the base frame to the selected system.

        It is p' = rotation · p + shift.
        """
        self._rotation, self._shift = np.eye(3), np.zeros(3)
        links = () if self.selected == MACHINE else CHAIN[: CHAIN.index(self.selected) + 1]
        for name in links:
            transformation = self.get(name)
            rotation = transformation.rotation()
            self._rotation = rotation @ self._rotation
            self._shift = rotation @ (self._shift - transformation.origin)

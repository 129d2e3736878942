"""Where an artefact stands: rigid poses in which the arm reaches every target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.simulator.artefact import Artefact
from armd.simulator.poses import Reach, Unreachable
from armd.simulator.truth.rotations import about

F64 = npt.NDArray[np.float64]

SHOULDER_MM = np.array([0.0, 0.0, 280.0])
#: Comfortable distances of a target from the shoulder, and from the column's axis, mm.
NEAR_MM, FAR_MM, COLUMN_MM = 260.0, 1000.0, 200.0
#: The table the arm stands on: nothing is measured far below it.
LOWEST_MM = -150.0
TRIES = 400


@dataclass(frozen=True)
class Placement:
    """A pose of the artefact in the base frame."""

    name: str
    rotation: F64  # (3, 3)
    origin_mm: F64  # (3,)

    def to_base(self, points: F64) -> F64:
        """Points (n, 3) of the artefact's frame in the base frame, mm."""
        moved: F64 = points @ self.rotation.T + self.origin_mm
        return moved


def place(
    name: str, artefact: Artefact, reach: Reach, count: int, rng: np.random.Generator
) -> tuple[Placement, F64]:
    """A random placement and *count* articulations of every target there (K, count, N)."""
    for _ in range(TRIES):
        candidate = _anywhere(name, artefact, rng)
        goals = candidate.to_base(artefact.true_mm)
        if not _comfortable(goals):
            continue
        try:
            return candidate, reach.articulations(goals, count)
        except Unreachable:
            continue
    raise Unreachable(f"no placement of the {artefact.name} that the arm reaches all of")


def _anywhere(name: str, artefact: Artefact, rng: np.random.Generator) -> Placement:
    """Turned about the vertical by any angle, tilted by up to a right angle."""
    azimuth, spin = rng.uniform(-np.pi, np.pi, 2)
    tilt = np.pi / 2 * rng.uniform() ** 2
    level = rng.uniform(0.0, 2 * np.pi)
    rotation = about(tilt * np.array([np.cos(level), np.sin(level), 0.0]))
    rotation = rotation @ about(np.array([0.0, 0.0, spin]))
    radius = rng.uniform(350.0, 800.0)
    middle = np.array([radius * np.cos(azimuth), radius * np.sin(azimuth), rng.uniform(0, 500)])
    return Placement(name, rotation, middle - rotation @ artefact.true_mm.mean(axis=0))


def _comfortable(goals: F64) -> bool:
    distance = np.linalg.norm(goals - SHOULDER_MM, axis=1)
    radius = np.linalg.norm(goals[:, :2], axis=1)
    inside = (distance > NEAR_MM) & (distance < FAR_MM) & (radius > COLUMN_MM)
    return bool((inside & (goals[:, 2] > LOWEST_MM)).all())

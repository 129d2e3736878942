"""Placements of an artefact: rigid poses in which the arm reaches every target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.measured.plan import Visit
from armd.simulator.measured.poses import Reach, Unreachable
from armd.simulator.truth.rotations import rotate_about

SHOULDER_MM = np.array([0.0, 0.0, 280.0])
#: The lowest target: not far below the table on which the arm stands.
LOWEST_MM = -150.0
#: The usual largest distance of an artefact's middle from the column, mm.
USUAL_MM = 800.0
TRIES = 2000


@dataclass(frozen=True)
class Placement:
    """A pose of the artefact in the base frame."""

    name: str
    rotation: F64  # (3, 3)
    origin_mm: F64  # (3,)

    def to_base(self, points: F64) -> F64:
        """Transform points (n, 3) of the artefact's frame to the base frame, mm."""
        moved: F64 = points @ self.rotation.T + self.origin_mm
        return moved


def place(
    visit: Visit, targets_mm: F64, reach: Reach, rng: np.random.Generator
) -> tuple[Placement, F64]:
    """Draw a placement for *visit*, and articulations of each target (K, count, N) in it.

    *targets_mm* (K, 3) are the visited targets in the artefact's frame. Raises `Unreachable`.
    """
    for _ in range(TRIES):
        candidate = _anywhere(visit, targets_mm.mean(axis=0), rng)
        goals = candidate.to_base(targets_mm)
        if not _comfortable(visit, goals):
            continue
        try:
            return candidate, reach.articulations(goals, visit.articulations)
        except Unreachable:
            continue
    raise Unreachable(f"no placement {visit.name} in which the arm reaches all targets")


def _anywhere(visit: Visit, centre_mm: F64, rng: np.random.Generator) -> Placement:
    """Draw a pose, turned about the vertical by any angle, tilted by up to a right angle."""
    azimuth, spin = rng.uniform(-np.pi, np.pi, 2)
    tilt = np.pi / 2 * rng.uniform() ** 2
    level = rng.uniform(0.0, 2 * np.pi)
    rotation = rotate_about(tilt * np.array([np.cos(level), np.sin(level), 0.0]))
    rotation = rotation @ rotate_about(np.array([0.0, 0.0, spin]))
    low, high = visit.radius_mm
    radius = rng.uniform(low, high if low > USUAL_MM else min(high, USUAL_MM))
    middle = np.array([radius * np.cos(azimuth), radius * np.sin(azimuth), rng.uniform(0, 500)])
    return Placement(visit.name, rotation, middle - rotation @ centre_mm)


def _comfortable(visit: Visit, goals: F64) -> bool:
    distance = np.linalg.norm(goals - SHOULDER_MM, axis=1)
    radius = np.linalg.norm(goals[:, :2], axis=1)
    inside = (distance > visit.shoulder_mm[0]) & (distance < visit.shoulder_mm[1])
    inside &= (radius > visit.radius_mm[0]) & (radius < visit.radius_mm[1])
    return bool((inside & (goals[:, 2] > LOWEST_MM)).all())

"""Positions of a placement's targets in the base frame, as far as its readings show."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from armd.arrays import F64
from armd.compensation.data.sessions.format import Artefact
from armd.compensation.estimate.placements.rigid_motions import fit_by_kabsch

#: Points nearer to one line than this do not determine the artefact's rotation about it.
LEAST_SPAN_MM = 20.0
#: A target this near to the line of the measured ones is located by them.
ON_LINE_MM = 2.0


class Whereabouts:
    """The positions of one placement's targets.

    *measured* maps a target's name to the points (k, 3) mm taken there. Surfaces have no position,
    because they are touched anywhere.
    """

    def __init__(self, artefact: Artefact, measured: Mapping[str, F64]) -> None:
        kinds = artefact.surface_kinds
        self._positions = {
            name: points.mean(axis=0) for name, points in measured.items() if name not in kinds
        }
        positions = artefact.positions_mm()
        self._certified = {
            name: position
            for name, position in zip(artefact.target_names, positions, strict=True)
            if np.isfinite(position).all() and name not in kinds
        }
        self._lengths = {
            frozenset(distance.between): distance.length_mm for distance in artefact.distances
        }
        names = [name for name in self._positions if name in self._certified]
        self._span = np.zeros((0, 3))  # unit vectors of the extent of the measured targets
        if not names:
            return
        local = np.array([self._certified[name] for name in names])
        base = np.array([self._positions[name] for name in names])
        group, weight = np.zeros(len(names), np.int64), np.ones(len(names))
        rotation, translation = fit_by_kabsch(local, base, weight, group, 1)
        self._rotation, self._translation = rotation[0], translation[0]
        self._middle = local.mean(axis=0)
        _, extent, vectors = np.linalg.svd(local - self._middle, full_matrices=False)
        self._span = vectors[extent > LEAST_SPAN_MM]

    def get_position(self, target: str) -> F64 | None:
        """Return a target's position (3,) mm, base frame; None while it is unknown."""
        if target in self._certified:
            return self._placed(self._certified[target])
        return self._positions.get(target)

    def is_measured(self, target: str) -> bool:
        """Return whether the target was measured in this placement."""
        return target in self._positions

    def find_target(self, point_mm: F64, near_mm: float, but: str | None = None) -> str | None:
        """Return the target at a point, other than *but*; None if no target is near."""
        distances_mm = {
            name: float(np.linalg.norm(point_mm - position))
            for name in (*self._certified, *self._positions)
            if name != but and (position := self.get_position(name)) is not None
        }
        if not distances_mm:
            return None
        nearest = min(distances_mm, key=lambda name: distances_mm[name])
        return nearest if distances_mm[nearest] <= near_mm else None

    def contradiction_mm(self, target: str, point_mm: F64) -> tuple[str, float, float] | None:
        """Find the measured target whose distance from *target* disagrees most.

        Returns its name, the measured and the certified distance, mm; None if no distance is
        certified.
        """
        worst: tuple[str, float, float] | None = None
        for name, position in self._positions.items():
            certified = self._between(target, name)
            if name == target or certified is None:
                continue
            measured = float(np.linalg.norm(point_mm - position))
            if worst is None or abs(measured - certified) > abs(worst[1] - worst[2]):
                worst = name, measured, certified
        return worst

    def find_suspects(self, target: str, point_mm: F64, near_mm: float) -> list[str]:
        """Return the measured targets that may be wrong if *target* is at a point.

        Each of them alone, at another position, would end every contradiction of certified
        distances. *target* itself is not listed.
        """
        positions = {**self._positions, target: point_mm}
        torn = [
            (a, b)
            for a, b in itertools.combinations(positions, 2)
            if (certified := self._between(a, b)) is not None
            and abs(float(np.linalg.norm(positions[a] - positions[b])) - certified) > near_mm
        ]
        suspects = [name for name in self._positions if all(name in pair for pair in torn)]
        return [name for name in suspects if torn and name != target]

    def find_by_distances(self, point_mm: F64, near_mm: float) -> str | None:
        """Return the only unmeasured target with a point's distances from all measured ones."""
        fitting = []
        for name in self._certified.keys() - self._positions.keys():
            certified = {reference: self._between(name, reference) for reference in self._positions}
            away = {
                reference: float(np.linalg.norm(point_mm - self._positions[reference]))
                for reference in certified
            }
            lengths = {
                reference: length for reference, length in certified.items() if length is not None
            }
            if lengths and all(
                abs(away[reference] - lengths[reference]) <= near_mm for reference in lengths
            ):
                fitting.append(name)
        return fitting[0] if len(fitting) == 1 else None

    def _between(self, first: str, second: str) -> float | None:
        if first in self._certified and second in self._certified:
            return float(np.linalg.norm(self._certified[first] - self._certified[second]))
        return self._lengths.get(frozenset((first, second)))

    def _placed(self, local: F64) -> F64 | None:
        if not any(name in self._certified for name in self._positions):
            return None
        away = local - self._middle
        if len(self._span) < 2 and np.linalg.norm(away - self._span.T @ (self._span @ away)) > (
            ON_LINE_MM
        ):
            return None
        placed: F64 = self._rotation @ local + self._translation
        return placed

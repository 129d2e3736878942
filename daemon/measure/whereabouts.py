"""Where the targets of a placement stand in the base frame, as far as its readings tell."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from armd.compensation.data.session_format import Artefact
from armd.compensation.estimate.poses import kabsch

F64 = npt.NDArray[np.float64]

#: Points nearer to one line (or plane) than this do not tell how the artefact is turned about it.
LEAST_SPAN_MM = 20.0
#: A target this near to the line of those measured is told by them.
ON_LINE_MM = 2.0


class Whereabouts:
    """Of one placement; *measured* maps a target's name to the points (k, 3) mm taken there."""

    def __init__(self, artefact: Artefact, measured: Mapping[str, F64]) -> None:
        self._seen = {name: points.mean(axis=0) for name, points in measured.items()}
        positions = artefact.positions_mm()
        self._certified = {
            name: position
            for name, position in zip(artefact.target_names, positions, strict=True)
            if np.isfinite(position).all()
        }
        self._lengths = {
            frozenset(distance.between): distance.length_mm for distance in artefact.distances
        }
        names = [name for name in self._seen if name in self._certified]
        self._span = np.zeros((0, 3))  # unit vectors in which the measured ones extend
        if not names:
            return
        local = np.array([self._certified[name] for name in names])
        base = np.array([self._seen[name] for name in names])
        group, weight = np.zeros(len(names), np.int64), np.ones(len(names))
        rotation, translation = kabsch(local, base, weight, group, 1)
        self._rotation, self._translation = rotation[0], translation[0]
        self._middle = local.mean(axis=0)
        _, extent, vectors = np.linalg.svd(local - self._middle, full_matrices=False)
        self._span = vectors[extent > LEAST_SPAN_MM]

    def of(self, target: str) -> F64 | None:
        """Where a target must be (3,) mm, base frame; None while nobody knows."""
        if target in self._certified:
            return self._placed(self._certified[target])
        return self._seen.get(target)

    def at(self, point_mm: F64, near_mm: float, but: str | None = None) -> str | None:
        """The target that a point belongs to, where that is plain, and not *but*."""
        found = {
            name: float(np.linalg.norm(point_mm - where))
            for name in (*self._certified, *self._seen)
            if name != but and (where := self.of(name)) is not None
        }
        if not found:
            return None
        nearest = min(found, key=lambda name: found[name])
        return nearest if found[nearest] <= near_mm else None

    def contradiction_mm(self, target: str, point_mm: F64) -> tuple[str, float, float] | None:
        """The measured target whose distance disagrees most: its name, the distance measured and
        the certified one, mm; None where nothing is certified between them."""
        worst: tuple[str, float, float] | None = None
        for name, seen in self._seen.items():
            certified = self._between(target, name)
            if name == target or certified is None:
                continue
            measured = float(np.linalg.norm(point_mm - seen))
            if worst is None or abs(measured - certified) > abs(worst[1] - worst[2]):
                worst = name, measured, certified
        return worst

    def _between(self, one: str, other: str) -> float | None:
        if one in self._certified and other in self._certified:
            return float(np.linalg.norm(self._certified[one] - self._certified[other]))
        return self._lengths.get(frozenset((one, other)))

    def _placed(self, local: F64) -> F64 | None:
        if not any(name in self._certified for name in self._seen):
            return None
        away = local - self._middle
        if len(self._span) < 2 and np.linalg.norm(away - self._span.T @ (self._span @ away)) > (
            ON_LINE_MM
        ):
            return None
        placed: F64 = self._rotation @ local + self._translation
        return placed

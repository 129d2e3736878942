"""Figures of an arm from one table of points: lengths, sizes, forms, and how well a
seat repeats.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from armd.arrays import F64
from armd.compensation.data.foreign.points import PointTable
from armd.compensation.data.sessions.format import Artefact
from armd.compensation.interim.points.surface_figures import (
    Groups,
    PointFigure,
    compute_sphere_figures,
    compute_surface_figures,
)
from armd.compensation.verify.points import UNKNOWN
from armd.errors import BadInput
from armd.terminal.suggest import suggest_names

#: The serial number of an arm of which only the points are known.
ARM = str(UNKNOWN["serial_number"])
#: Points on a certified sphere, by the names of docs/how-to/verify.md; the name of the set is
#: before the dot.
ON_SPHERE = re.compile(r"(SPHERE[12]|LDIA\.[1-5]|EFFDIA\.[1-3])\..+")
#: The ends of a sphere's certified diameter.
DIAMETER = frozenset(("SPHERE.a", "SPHERE.b"))
#: The fewest readings of a seat from which a spread is computed.
SEAT_READINGS = 4
#: With more targets, only certified lengths and lengths from the first target are compared.
MOST_IN_PAIRS = 8
#: A certified length whose error exceeds both, the second as a share of its length, belongs to
#: another target or unit.
FAR_OFF_MM, FAR_OFF = 5.0, 0.01


@dataclass(frozen=True)
class PointCheck:
    """A check of the history, or one that is to be kept."""

    name: str
    first_unix_s: float
    last_unix_s: float
    artefact: str  # SHA-256 of its file
    tip_radius_mm: float
    figures: tuple[PointFigure, ...]
    files: dict[str, str]  # name → SHA-256

    @property
    def epoch(self) -> tuple[str, float]:
        """The artefact and the tip radius; checks that share both are compared."""
        return self.artefact, self.tip_radius_mm


def compute_figures(
    path: Path, points: PointTable, artefact: Artefact, tip_radius_mm: float
) -> list[PointFigure]:
    """Compute all figures of a table.

    Raises `BadInput` for a target that the artefact does not have, for a table without figures, and
    for a certified length that is far off.
    """
    artefact = artefact.with_documented(points.target)
    names = artefact.target_names
    for row, name in enumerate(points.target, 1):
        if name not in names:
            expected = f"a target of the artefact{suggest_names(name, names)}"
            raise BadInput(path, f"row {row}, target", repr(name), expected)
    groups = _group_points(points)
    kinds = artefact.surface_kinds
    on_surfaces = {key: positions for key, positions in groups.items() if key[1] in kinds}
    at_points = {
        key: positions
        for key, positions in groups.items()
        if key[1] not in kinds and not ON_SPHERE.fullmatch(key[1])
    }
    figures = list(_measure_lengths(artefact, at_points))
    figures += _measure_spheres(artefact, groups, tip_radius_mm)
    figures += compute_surface_figures(artefact, on_surfaces, tip_radius_mm)
    figures += _measure_seats(at_points)
    if not figures:
        problem = (
            f"{len(points.target)} points at {', '.join(list(dict.fromkeys(points.target))[:6])}"
        )
        expected = (
            "two targets, six points on a sphere, four on a plane, or four readings of a seat"
        )
        raise BadInput(path, "the table", problem, expected)
    for figure in figures:
        off = abs(figure.value_mm) > max(FAR_OFF_MM, FAR_OFF * figure.longest_mm)
        if figure.longest_mm and off:
            problem = f"{figure.value_mm:+.3f} mm off its certified {figure.longest_mm:g} mm"
            expected = "these targets, and their unit (x [in] in the header, if inches)"
            raise BadInput(path, figure.name, problem, expected)
    return figures


def _group_points(points: PointTable) -> Groups:
    rows: dict[tuple[str, str], list[int]] = {}
    for i, key in enumerate(zip(points.placement, points.target, strict=True)):
        rows.setdefault(key, []).append(i)
    return {key: points.position_mm[chosen] for key, chosen in rows.items()}


def _measure_lengths(artefact: Artefact, groups: Groups) -> Iterator[PointFigure]:
    """Measure lengths between the means of two targets in one placement, averaged
    over placements.
    """
    placements = list(dict.fromkeys(placement for placement, _ in groups))
    certified = {frozenset(d.between): d.length_mm for d in artefact.distances}
    own_mm = _compute_scatter_mm(groups)
    relative: list[tuple[float, float]] = []
    for first, second in _list_pairs(artefact, groups):
        errors, variances, length = [], [], certified.get(frozenset((first, second)), math.nan)
        if math.isnan(length):
            length = _measure_distance_mm(artefact, first, second)
        for placement in placements:
            ends = [groups.get((placement, name)) for name in (first, second)]
            if ends[0] is None or ends[1] is None:
                continue
            measured = float(np.linalg.norm(ends[1].mean(axis=0) - ends[0].mean(axis=0)))
            errors.append(measured - (0.0 if math.isnan(length) else length))
            variances.append(own_mm**2 * (1 / len(ends[0]) + 1 / len(ends[1])))
        if not errors:
            continue
        value, deviation = float(np.mean(errors)), math.sqrt(sum(variances)) / len(errors)
        is_certified = math.isfinite(length)
        longest = length if is_certified else 0.0
        yield PointFigure(f"length {first} to {second}", value, deviation, longest_mm=longest)
        if is_certified:
            relative.append((length, value))
    if len(relative) > 2:
        yield _measure_scale(np.array(relative), own_mm)


def _measure_scale(relative: F64, own_mm: float) -> PointFigure:
    """Fit the common scale error of all certified lengths, stated at the longest one.

    *relative* (n, 2) holds length and error, mm.
    """
    length, error = relative.T
    longest, square = float(length.max()), float(length @ length)
    deviation = own_mm * math.sqrt(2 / square) * longest
    return PointFigure(
        "scale, at the longest length", float(length @ error) / square * longest, deviation
    )


def _list_pairs(artefact: Artefact, groups: Groups) -> list[tuple[str, str]]:
    """List the pairs of targets whose lengths are compared, the certified ones first."""
    measured = list(dict.fromkeys(target for _, target in groups))
    listed = [d.between for d in artefact.distances if frozenset(d.between) != DIAMETER]
    located = [name for name in measured if _find_position(artefact, name) is not None]
    rest = located if listed or len(located) > 1 else measured
    combined = combinations(rest, 2)
    pairs = [
        *listed,
        *(pair for pair in combined if len(rest) <= MOST_IN_PAIRS or pair[0] == rest[0]),
    ]
    return list({frozenset(pair): pair for pair in reversed(pairs)}.values())[::-1]


def _find_position(artefact: Artefact, name: str) -> F64 | None:
    position = artefact.targets[artefact.target_names.index(name)].position_mm
    return None if position is None else np.array(position)


def _measure_distance_mm(artefact: Artefact, first: str, second: str) -> float:
    ends = _find_position(artefact, first), _find_position(artefact, second)
    if ends[0] is None or ends[1] is None:
        return math.nan
    return float(np.linalg.norm(ends[1] - ends[0]))


def _compute_scatter_mm(groups: Groups) -> float:
    """Compute a reading's standard deviation along one axis from repeats; NaN without them."""
    repeated = [positions for positions in groups.values() if len(positions) > 1]
    freedom = sum(len(positions) - 1 for positions in repeated)
    if freedom < 2:
        return math.nan
    squares = sum(
        float(((positions - positions.mean(axis=0)) ** 2).sum()) for positions in repeated
    )
    return math.sqrt(squares / (3 * freedom))


def _measure_spheres(
    artefact: Artefact, groups: Groups, tip_radius_mm: float
) -> Iterator[PointFigure]:
    diameter = next((d.length_mm for d in artefact.distances if set(d.between) == DIAMETER), 0.0)
    sets: dict[str, list[F64]] = {}
    for (placement, target), positions in groups.items():
        if ON_SPHERE.fullmatch(target):
            name = target.rpartition(".")[0] + ("" if placement == "1" else f" in {placement}")
            sets.setdefault(name, []).append(positions)
    for name, parts in sets.items():
        on = np.vstack(parts)
        yield from compute_sphere_figures(name, on, diameter, tip_radius_mm)


def _measure_seats(groups: Groups) -> Iterator[PointFigure]:
    """Compute the 3-D standard deviation of the readings of each seat, over its placements."""
    for name in dict.fromkeys(target for _, target in groups):
        sets: Sequence[F64] = [
            positions for (_, target), positions in groups.items() if target == name
        ]
        freedom = sum(len(positions) - 1 for positions in sets)
        if freedom < SEAT_READINGS - 1:
            continue
        squares = sum(
            float(((positions - positions.mean(axis=0)) ** 2).sum()) for positions in sets
        )
        yield PointFigure(f"spread {name}", math.sqrt(squares / freedom), freedom=freedom)

"""Drawings of a verification: lengths with their limits, rosettes of seats, spheres' form."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from armd.arrays import F64
from armd.compensation.report.drawing import COLOURS, drawing, one_drawing
from armd.compensation.report.units import Unit
from armd.compensation.verify.limits import PermissibleErrors
from armd.compensation.verify.results import Deviation
from armd.compensation.verify.verdict import COVERAGE_FACTOR, Judged

#: More placements than colours that can be told apart.
MOST_NAMED = 7
SIDE_IN = 3.0
#: Placements at one length stand beside each other, over this share of the longest.
APART = 0.08
#: A limit so many times what was found would make a dot of it.
FAR = 4.0


def lengths(item: Judged, limits: PermissibleErrors | None, unit: Unit) -> Figure:
    """Errors over length with ± U, a colour for each placement, within the band of the MPE."""
    figure, panel = one_drawing(3.1)
    deviations = item.figure.deviations
    longest = max(one.length_mm for one in deviations)
    places = list(dict.fromkeys(one.placement for one in deviations))
    apart_mm = APART * longest / max(len(places), MOST_NAMED)
    for i, place in enumerate(places):
        own = [one for one in deviations if one.placement == place]
        panel.errorbar(
            [one.length_mm + (i - (len(places) - 1) / 2) * apart_mm for one in own],
            [unit.per_base * one.value_mm for one in own],
            [unit.per_base * COVERAGE_FACTOR * one.standard_uncertainty_mm for one in own],
            fmt="o", markersize=3.5, elinewidth=0.8, alpha=0.8,
            color=COLOURS[i % MOST_NAMED], label=place if len(places) <= MOST_NAMED else None,
        )  # fmt: skip
    if limits is not None and item.limit_mm is not None:
        at = np.linspace(0.0, 1.05 * longest, 2)
        limit = unit.per_base * np.array([limits.mpe.of(item.figure.key, x) or 0.0 for x in at])
        panel.fill_between(at, -limit, limit, color=COLOURS[2], alpha=0.12, linewidth=0)
        for sign in (-1, 1):
            panel.plot(at, sign * limit, "--", color=COLOURS[2], label="MPE" * (sign > 0))
    panel.axhline(0.0, color="black", linewidth=0.5)
    panel.set(xlabel="length, mm", ylabel=f"error, {unit.name}")
    if panel.get_legend_handles_labels()[1]:
        figure.legend(loc="outside upper left", ncols=8, frameon=False)
    return figure


def rosettes(item: Judged, unit: Unit) -> Figure | None:
    """Each seat's readings about their mean, from above and from the side; None without points."""
    seats = [one for one in item.figure.deviations if one.offsets_mm is not None]
    if not seats:
        return None
    figure, panels = drawing(2, len(seats), 2 * 2.6)
    limit = (item.limit_mm or 0.0) * unit.per_base
    largest = max(unit.per_base * _largest(one) for one in seats)
    shown = limit <= FAR * largest
    reach = 1.15 * max(limit if shown else 0.0, largest, 1e-9)
    for column, one in enumerate(seats):
        assert one.offsets_mm is not None
        offsets = unit.per_base * one.offsets_mm
        for row, up in enumerate((1, 2)):
            panel = panels[row * len(seats) + column]
            _rosette(panel, offsets[:, 0], offsets[:, up], limit, reach)
            panel.set(xlabel=f"x, {unit.name}", ylabel=f"{'xyz'[up]}, {unit.name}")
        panels[column].set_title(one.where)
    if not shown:
        figure.suptitle(f"the MPE, {limit:g} {unit.name}, is outside of the picture", fontsize=9.0)
    return figure


def sphere_form(item: Judged, unit: Unit) -> Figure | None:
    """Each sphere seen from its pole: how far each point lies off the fitted sphere."""
    spheres = [one for one in item.figure.deviations if one.offsets_mm is not None]
    if not spheres:
        return None
    figure, panels = drawing(1, len(spheres), SIDE_IN)
    shown = [_from_pole(one.offsets_mm) for one in spheres if one.offsets_mm is not None]
    most = max(float(np.abs(radial).max()) for _, radial in shown) * unit.per_base or 1.0
    points = None
    for panel, one, (place, radial) in zip(panels, spheres, shown, strict=True):
        for angle in (30, 60, 90):
            _circle(panel, angle, "#8c959f", ":")
        points = panel.scatter(
            place[:, 0], place[:, 1], 40.0, radial * unit.per_base, cmap="coolwarm", vmin=-most,
            vmax=most, edgecolors="black", linewidths=0.4,
        )  # fmt: skip
        panel.set_title(f"{one.where}: {unit.text(one.value_mm)} {unit.name}")
        panel.set_aspect("equal", adjustable="datalim")
        panel.set(xlabel="from the pole, °", ylabel="from the pole, °")
    if points is not None:
        figure.colorbar(points, ax=panels, label=f"off the sphere, {unit.name}")
    return figure


def _largest(one: Deviation) -> float:
    assert one.offsets_mm is not None
    return float(np.linalg.norm(one.offsets_mm, axis=1).max())


def _rosette(panel: Axes, x: F64, y: F64, limit: float, reach: float) -> None:
    rays = np.stack([np.zeros_like(x), x, np.full_like(x, np.nan)], axis=1).ravel()
    ups = np.stack([np.zeros_like(y), y, np.full_like(y, np.nan)], axis=1).ravel()
    panel.plot(rays, ups, color=COLOURS[0], linewidth=0.8, alpha=0.6)
    panel.plot(x, y, "o", color=COLOURS[0], markersize=3.5)
    if limit:
        _circle(panel, limit, COLOURS[1], "--")
    panel.set(xlim=(-reach, reach), ylim=(-reach, reach))
    panel.set_aspect("equal", adjustable="box")


def _circle(panel: Axes, radius: float, colour: str, line: str) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 121)
    panel.plot(radius * np.cos(turn), radius * np.sin(turn), line, color=colour, linewidth=0.8)


def _from_pole(offsets_mm: F64) -> tuple[F64, F64]:
    """Points (n, 2) by direction and angle from the pole in degrees, and mm off the sphere."""
    distance = np.linalg.norm(offsets_mm, axis=1)
    pole = offsets_mm.mean(axis=0)
    pole = pole / max(float(np.linalg.norm(pole)), 1e-12)
    first = np.cross(pole, [1.0, 0.0, 0.0] if abs(pole[0]) < 0.9 else [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(pole, first)
    angle = np.degrees(np.arccos(np.clip(offsets_mm @ pole / distance, -1.0, 1.0)))
    turn = np.arctan2(offsets_mm @ second, offsets_mm @ first)
    place = np.column_stack([angle * np.cos(turn), angle * np.sin(turn)])
    return place, distance - distance.mean()

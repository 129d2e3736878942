"""Drawings of a verification: lengths with their limits, rosettes of seats, spheres' form."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from armd.arrays import F64
from armd.compensation.report.layout.drawing import COLOURS, make_figure, make_single_figure
from armd.compensation.report.layout.units import Unit
from armd.compensation.verify.limits import PermissibleErrors
from armd.compensation.verify.results import Deviation
from armd.compensation.verify.verdict import COVERAGE_FACTOR, Judged

#: The most placements with a colour and a name of their own.
MOST_NAMED = 7
SIDE_IN = 3.0
#: Placements at one length are drawn side by side, over this share of the longest length.
APART = 0.08
#: A limit more than this many times the largest deviation is not drawn.
FAR = 4.0


def draw_lengths(item: Judged, limits: PermissibleErrors | None, unit: Unit) -> Figure:
    """Draw errors over length with ± U, a colour for each placement, within the band of the MPE."""
    figure, panel = make_single_figure(3.1)
    deviations = item.figure.deviations
    longest = max(deviation.length_mm for deviation in deviations)
    places = list(dict.fromkeys(deviation.placement for deviation in deviations))
    apart_mm = APART * longest / max(len(places), MOST_NAMED)
    expanded = unit.per_base * COVERAGE_FACTOR
    for i, place in enumerate(places):
        placed = [deviation for deviation in deviations if deviation.placement == place]
        panel.errorbar(
            [deviation.length_mm + (i - (len(places) - 1) / 2) * apart_mm for deviation in placed],
            [unit.per_base * deviation.value_mm for deviation in placed],
            [expanded * deviation.standard_uncertainty_mm for deviation in placed],
            fmt="o", markersize=3.5, elinewidth=0.8, alpha=0.8,
            color=COLOURS[i % MOST_NAMED], label=place if len(places) <= MOST_NAMED else None,
        )  # fmt: skip
    if limits is not None and item.limit_mm is not None:
        ends_mm = np.linspace(0.0, 1.05 * longest, 2)
        limit = unit.per_base * np.array(
            [limits.mpe.limit_mm(item.figure.key, x) or 0.0 for x in ends_mm]
        )
        panel.fill_between(ends_mm, -limit, limit, color=COLOURS[2], alpha=0.12, linewidth=0)
        for sign in (-1, 1):
            panel.plot(ends_mm, sign * limit, "--", color=COLOURS[2], label="MPE" * (sign > 0))
    panel.axhline(0.0, color="black", linewidth=0.5)
    panel.set(xlabel="length, mm", ylabel=f"error, {unit.name}")
    if panel.get_legend_handles_labels()[1]:
        figure.legend(loc="outside upper left", ncols=8, frameon=False)
    return figure


def draw_rosettes(item: Judged, unit: Unit) -> Figure | None:
    """Draw each seat's readings about their mean, from above and from the side.

    Returns None if there are no points.
    """
    seats = [deviation for deviation in item.figure.deviations if deviation.offsets_mm is not None]
    if not seats:
        return None
    figure, panels = make_figure(2, len(seats), 2 * 2.6)
    limit = (item.limit_mm or 0.0) * unit.per_base
    largest = max(unit.per_base * _get_largest(deviation) for deviation in seats)
    is_limit_shown = limit <= FAR * largest
    reach = 1.15 * max(limit if is_limit_shown else 0.0, largest, 1e-9)
    for column, deviation in enumerate(seats):
        assert deviation.offsets_mm is not None
        offsets = unit.per_base * deviation.offsets_mm
        for row, up in enumerate((1, 2)):
            panel = panels[row * len(seats) + column]
            _draw_rosette(panel, offsets[:, 0], offsets[:, up], limit, reach)
            panel.set(xlabel=f"x, {unit.name}", ylabel=f"{'xyz'[up]}, {unit.name}")
        panels[column].set_title(deviation.label)
    if not is_limit_shown:
        figure.suptitle(f"the MPE, {limit:g} {unit.name}, is outside of the picture", fontsize=9.0)
    return figure


def draw_sphere_form(item: Judged, unit: Unit) -> Figure | None:
    """Draw each sphere seen from its pole, with the distance of each point from the
    fitted sphere.
    """
    spheres = [
        deviation for deviation in item.figure.deviations if deviation.offsets_mm is not None
    ]
    if not spheres:
        return None
    figure, panels = make_figure(1, len(spheres), SIDE_IN)
    outlines = [
        _measure_from_pole(deviation.offsets_mm)
        for deviation in spheres
        if deviation.offsets_mm is not None
    ]
    largest = max(float(np.abs(radial).max()) for _, radial in outlines) * unit.per_base or 1.0
    points = None
    for panel, deviation, (place, radial) in zip(panels, spheres, outlines, strict=True):
        for angle in (30, 60, 90):
            _draw_circle(panel, angle, "#8c959f", ":")
        points = panel.scatter(
            place[:, 0], place[:, 1], 40.0, radial * unit.per_base, cmap="coolwarm", vmin=-largest,
            vmax=largest, edgecolors="black", linewidths=0.4,
        )  # fmt: skip
        panel.set_title(f"{deviation.label}: {unit.format_value(deviation.value_mm)} {unit.name}")
        panel.set_aspect("equal", adjustable="datalim")
        panel.set(xlabel="from the pole, °", ylabel="from the pole, °")
    if points is not None:
        figure.colorbar(points, ax=panels, label=f"off the sphere, {unit.name}")
    return figure


def _get_largest(deviation: Deviation) -> float:
    assert deviation.offsets_mm is not None
    return float(np.linalg.norm(deviation.offsets_mm, axis=1).max())


def _draw_rosette(panel: Axes, x: F64, y: F64, limit: float, reach: float) -> None:
    rays = np.stack([np.zeros_like(x), x, np.full_like(x, np.nan)], axis=1).ravel()
    ups = np.stack([np.zeros_like(y), y, np.full_like(y, np.nan)], axis=1).ravel()
    panel.plot(rays, ups, color=COLOURS[0], linewidth=0.8, alpha=0.6)
    panel.plot(x, y, "o", color=COLOURS[0], markersize=3.5)
    if limit:
        _draw_circle(panel, limit, COLOURS[1], "--")
    panel.set(xlim=(-reach, reach), ylim=(-reach, reach))
    panel.set_aspect("equal", adjustable="box")


def _draw_circle(panel: Axes, radius: float, colour: str, line: str) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 121)
    panel.plot(radius * np.cos(turn), radius * np.sin(turn), line, color=colour, linewidth=0.8)


def _measure_from_pole(offsets_mm: F64) -> tuple[F64, F64]:
    """Return points (n, 2) by direction and angle from the pole in degrees, and mm off
    the sphere.
    """
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

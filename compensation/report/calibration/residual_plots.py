"""Plots of signed residuals: along each joint's motion, away from the base, and as vectors."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from armd.arrays import F64, I64
from armd.compensation.report.layout.drawing import (
    COLOURS,
    MOST_POINTS,
    draw_dots,
    make_figure,
    make_views,
)
from armd.compensation.report.layout.units import Unit, Units

#: Readings whose lever on a joint is below this share of the median are not shown for that joint.
LEAST_LEVER = 0.3
MOST_BINS, LEAST_READINGS = 16, 8
#: Half the width of the band about a running mean, in its standard uncertainties.
BAND = 1.96
#: The drawn length of a typical residual, as a share of the measured volume's diagonal.
DRAWN_SHARE = 0.04
ROW_IN = 2.1


def draw_residuals_by_joint(q: F64, joints: F64, residual_mm: F64, units: Units) -> Figure:
    """Draw residuals (n, 3) along each joint's motion over the joint's angle.

    *joints* (n, 3, N) mm/rad are the derivatives by the angles *q* (n, N). Each panel has the
    readings, their running mean and the 95 % band of that mean.
    """
    count = q.shape[1]
    rows = -(-count // 3)
    figure, panels = make_figure(rows, 3, ROW_IN * rows)
    for k, panel in enumerate(panels[:count]):
        lever_squared = (joints[:, :, k] ** 2).sum(axis=1)
        has_lever = lever_squared > LEAST_LEVER**2 * np.median(lever_squared)
        along = (joints[:, :, k] * residual_mm).sum(axis=1) / np.where(
            has_lever, lever_squared, 1.0
        )
        has_lever &= np.isfinite(along)
        _draw(panel, np.degrees(q[has_lever, k]), along[has_lever] * units.angle.per_base)
        panel.set_xlabel(f"joint {k + 1}, °")
        panel.set_ylabel(f"residual, {units.angle.name}" if k % 3 == 0 else "")
    for panel in panels[count:]:
        panel.set_axis_off()
    return figure


def draw_residuals_by_sensor(
    celsius: F64, names: list[str], tip_mm: F64, residual_mm: F64, unit: Unit
) -> Figure | None:
    """Draw residuals away from the base's axis over each sensor; None if no temperature
    is known.
    """
    measured_sensors = [s for s in range(len(names)) if np.isfinite(celsius[:, s]).any()]
    if not measured_sensors:
        return None
    out = tip_mm * [1.0, 1.0, 0.0]
    out /= np.maximum(np.linalg.norm(out, axis=1), 1e-9)[:, None]
    along = (out * residual_mm).sum(axis=1) * unit.per_base
    rows = -(-len(measured_sensors) // 3)
    figure, panels = make_figure(rows, 3, ROW_IN * rows)
    for i, (panel, s) in enumerate(zip(panels, measured_sensors, strict=False)):
        measured = np.isfinite(celsius[:, s]) & np.isfinite(along)
        _draw(panel, celsius[measured, s], along[measured])
        panel.set_xlabel(f"{names[s]}, °C")
        panel.set_ylabel(f"residual outwards, {unit.name}" if i % 3 == 0 else "")
    for panel in panels[len(measured_sensors) :]:
        panel.set_axis_off()
    return figure


def draw_vectors(tip_mm: F64, residual_mm: F64, unit: Unit) -> tuple[Figure, float]:
    """Draw each tip position (n, 3) with its residual; return the figure and the enlargement."""
    finite = np.flatnonzero(np.isfinite(residual_mm).all(axis=1))
    rows = finite[select_rows(len(finite))]
    tip, residual = tip_mm[rows], residual_mm[rows]
    size = float(np.median(np.linalg.norm(residual, axis=1))) or 1.0
    reach = float(np.linalg.norm(np.ptp(tip, axis=0)))
    times = choose_round(DRAWN_SHARE * reach / size)
    key_mm = choose_round(4.0 * size)
    name = f"{key_mm * unit.per_base:g} {unit.name}"
    figure, panels = make_views(3.9)
    for panel, across, up in panels:
        panel.quiver(
            tip[:, across], tip[:, up], times * residual[:, across], times * residual[:, up],
            angles="xy", scale_units="xy", scale=1.0, width=0.002, color=COLOURS[0],
            rasterized=True,
        )  # fmt: skip
        _draw_scale_bar(panel, tip[:, [across, up]], times * key_mm, name)
    return figure, times


def _draw_scale_bar(panel: Axes, points: F64, length: float, name: str) -> None:
    """Draw a scale bar below the points (n, 2); the points alone set the range shown."""
    low, high = points.min(axis=0), points.max(axis=0)
    below = low[1] - 0.1 * max(high[1] - low[1], length)
    panel.plot([low[0], low[0] + length], [below, below], color="black", linewidth=2.0, marker="|")
    panel.annotate(
        name, (low[0] + length, below), xytext=(6, 0), textcoords="offset points", va="center",
        weight="bold",
    )  # fmt: skip
    panel.update_datalim(points)
    panel.margins(0.1)
    panel.autoscale_view()


def choose_round(value: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that is not above *value*."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value * 1.0001))


def select_rows(n: int) -> I64:
    """Select the rows to draw: all, or at most `MOST_POINTS`, evenly spread."""
    return np.linspace(0, n - 1, min(n, MOST_POINTS)).astype(np.int64)


def compute_running_mean(x: F64, y: F64) -> tuple[F64, F64, F64]:
    """Compute means over bins of equal count: middle, mean and its standard uncertainty (B,)."""
    bins = min(MOST_BINS, len(x) // LEAST_READINGS)
    if bins < 1:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    groups = np.array_split(np.argsort(x, kind="stable"), bins)
    middle = np.array([np.median(x[group]) for group in groups])
    mean = np.array([y[group].mean() for group in groups])
    sigma = np.array([y[group].std(ddof=1) / np.sqrt(len(group)) for group in groups])
    return middle, mean, sigma


def _draw(panel: Axes, x: F64, y: F64) -> None:
    rows = select_rows(len(x))
    draw_dots(panel, x[rows], y[rows])
    middle, mean, sigma = compute_running_mean(x, y)
    panel.fill_between(
        middle, mean - BAND * sigma, mean + BAND * sigma, color=COLOURS[1], alpha=0.3, linewidth=0
    )
    panel.plot(middle, mean, color=COLOURS[1], linewidth=1.5)
    panel.axhline(0.0, color="black", linewidth=0.5)
    if len(y):  # one stray reading must not compress all others
        reach = 1.3 * float(np.quantile(np.abs(y), 0.99)) + 1e-12
        panel.set_ylim(-reach, reach)

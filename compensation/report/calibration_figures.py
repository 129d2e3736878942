"""Drawings of a calibration: before and after, and what it leaves."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import LogFormatter

from armd.arrays import I64
from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import Identification
from armd.compensation.identify.result import Result
from armd.compensation.identify.thermal.temperatures import temperature_groups
from armd.compensation.report.drawing import MOST_POINTS, cloud, drawing, one_drawing, views
from armd.compensation.report.page import Page
from armd.compensation.report.units import Unit, Units

#: Of a table before the appendix; the drawing says the same.
MOST_ROWS = 9
#: One mark for each model.
MARKS = "osD^"


def before_and_after(page: Page, result: Result, unit: Unit) -> None:
    """3-D RMS by model and temperature of the arm."""
    found = result.fit
    observations, arm = found.observations, found.observations.arm
    groups = temperature_groups(observations) or [(np.nan, np.ones(observations.n, dtype=bool))]
    models = {"as drawn": (arm.nominal(), []), "identified": (found.constants, found.terms)}
    if found.terms:
        models["identified, at the reference temperature"] = (found.constants, [])
        models["identified, with temperature"] = models.pop("identified")
    figure, panel = one_drawing(3.0)
    rows = []
    labels = [f"{mean:.1f} °C" if np.isfinite(mean) else "all" for mean, _ in groups]
    apart = 0.12
    for i, (name, (constants, terms)) in enumerate(models.items()):
        residual = evaluate_model(observations, constants, terms, found.reference_c)
        distance = residual.distance_um * unit.per_base / 1e3
        rms = [float(np.sqrt(np.mean(distance[mask] ** 2))) for _, mask in groups]
        at = np.arange(len(rms)) + apart * (i - (len(models) - 1) / 2)
        panel.plot(at, rms, MARKS[i], label=name)
        for label, (_, mask), value in zip(labels, groups, rms, strict=True):
            rows.append(
                [
                    name, label,
                    *(f"{x:.{unit.decimals}f}" for x in
                      (value, np.median(distance[mask]), distance[mask].max())),
                ]
            )  # fmt: skip
    panel.set_xticks(np.arange(len(labels)), labels)
    panel.set(yscale="log", ylabel=f"3-D RMS, {unit.name}", xlabel="temperature of the arm")
    panel.yaxis.set_major_formatter(LogFormatter())  # the usual one writes TeX
    panel.yaxis.set_minor_formatter(LogFormatter())
    panel.legend(loc="upper center", bbox_to_anchor=(0.5, 1.15), ncols=len(models), frameon=False)
    page.heading("Before and after, by temperature")
    page.figure(figure, f"3-D RMS of the readings used, {unit.name}, by model and temperature")
    if len(rows) <= MOST_ROWS:
        page.table(
            ["model", "temperature", *(f"{x}, {unit.name}" for x in ("RMS", "median", "maximum"))],
            rows,
        )


def residual_vectors(page: Page, found: Identification, unit: Unit) -> None:
    """Each tip position with its residual, much enlarged."""
    rows = _some(found.observations.n)
    tip, residual = found.at.position_mm[rows], found.at.residual_mm[rows]
    size = float(np.median(np.linalg.norm(residual, axis=1))) or 1.0
    reach = float(np.linalg.norm(np.ptp(tip, axis=0)))
    times = 10 ** np.floor(np.log10(0.03 * reach / size))
    ends = np.stack([tip, tip + times * residual, np.full_like(tip, np.nan)], axis=1)
    lines = ends.reshape(-1, 3)
    figure, panels = views()
    for panel, across, up in panels:
        panel.plot(lines[:, across], lines[:, up], linewidth=0.8, rasterized=True)
    page.heading("Residual vectors")
    page.figure(
        figure,
        f"At each tip position of the base frame its residual, drawn {times:g} times as long",
    )


def residuals_by_column(page: Page, found: Identification, units: Units) -> None:
    """The residual of each reading over each angle and each temperature."""
    observations = found.observations
    states, arm = observations.states, observations.arm
    columns = [(f"q{k + 1}, °", np.degrees(states.q[:, k])) for k in range(arm.n_joints)]
    columns += [
        (f"{name}, °C", states.temperature_c[:, s])
        for s, name in enumerate(arm.sensors)
        if np.isfinite(states.temperature_c[:, s]).any()
    ]
    rows = _some(observations.n)
    distance = 1e3 * np.linalg.norm(found.at.residual_mm, axis=1)
    lines = -(-len(columns) // 3)
    figure, axes = drawing(lines, 3, height_in=2.2 * lines)
    for i, (title, values) in enumerate(columns):
        panel = axes[i]
        cloud(panel, values[rows], distance[rows])
        panel.set(xlabel=title, ylabel="residual, µm" if i % 3 == 0 else "")
        panel.set_ylim(bottom=0.0)
    for panel in axes[len(columns) :]:
        panel.set_axis_off()
    page.heading("Residuals against each joint and each sensor")
    page.figure(figure, "3-D residual of each reading, µm, over each angle and each temperature")


def _some(n: int) -> I64:
    """Rows to draw: all, or as many as a page bears, evenly spread."""
    return np.linspace(0, n - 1, min(n, MOST_POINTS)).astype(np.int64)

"""Drawings of a calibration: the error before and after, the arm, and the residuals."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import LogFormatter

from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import Identification
from armd.compensation.identify.result import Result
from armd.compensation.identify.thermal.temperatures import group_temperatures
from armd.compensation.report.calibration.arm_picture import draw_arm_picture
from armd.compensation.report.calibration.residual_plots import (
    draw_residuals_by_joint,
    draw_residuals_by_sensor,
    draw_vectors,
)
from armd.compensation.report.layout.drawing import make_single_figure
from armd.compensation.report.layout.page import Page
from armd.compensation.report.layout.units import Unit, Units

#: The most rows of a table before the appendix; a longer one is omitted, as the drawing shows the
#: same.
MOST_ROWS = 9
#: One mark for each model.
MARKS = "osD^"


class _Plain(LogFormatter):
    """A formatter that writes the numbers it chooses without an exponent."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:g}" if super().__call__(x, pos) else ""


def draw_before_and_after(page: Page, result: Result, unit: Unit) -> None:
    """Draw the 3-D RMS by model and temperature of the arm."""
    fit = result.fit
    observations, arm = fit.observations, fit.observations.arm
    groups = group_temperatures(observations) or [(np.nan, np.ones(observations.n, dtype=bool))]
    models = {"as drawn": (arm.nominal(), []), "identified": (fit.constants, fit.terms)}
    if fit.terms:
        models["identified, at the reference temperature"] = (fit.constants, [])
        models["identified, with temperature"] = models.pop("identified")
    figure, panel = make_single_figure(3.0)
    rows = []
    labels = [f"{mean:.1f} °C" if np.isfinite(mean) else "all" for mean, _ in groups]
    spacing = 0.12
    for i, (name, (constants, terms)) in enumerate(models.items()):
        residual = evaluate_model(observations, constants, terms, fit.reference_c)
        distance = residual.distance_um * unit.per_base / 1e3
        rms = [float(np.sqrt(np.mean(distance[mask] ** 2))) for _, mask in groups]
        positions = np.arange(len(rms)) + spacing * (i - (len(models) - 1) / 2)
        panel.plot(positions, rms, MARKS[i], label=name)
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
    panel.yaxis.set_major_formatter(_Plain())  # the usual one writes TeX
    panel.yaxis.set_minor_formatter(_Plain())
    panel.legend(loc="upper center", bbox_to_anchor=(0.5, 1.15), ncols=len(models), frameon=False)
    page.add_heading("Before and after, by temperature")
    page.add_figure(figure, f"3-D RMS of the readings used, {unit.name}, by model and temperature")
    if len(rows) <= MOST_ROWS:
        page.add_table(
            ["model", "temperature", *(f"{x}, {unit.name}" for x in ("RMS", "median", "maximum"))],
            rows,
        )


def draw_arm(page: Page, fit: Identification) -> None:
    """Draw the arm in a measured posture, with the names of the identified constants."""
    q = fit.observations.states.q
    middle = q[np.argmin(np.abs(q - np.median(q, axis=0)).sum(axis=1))]
    page.add_heading("The arm and its parameters")
    page.add_figure(
        draw_arm_picture(fit.observations.arm, middle, fit.unknowns.constants),
        "The arm of arm.toml in a posture that was measured; of each frame x (orange), y (green)"
        " and z (blue), and the constants identified that place it",
    )


def draw_residual_vectors(page: Page, fit: Identification, unit: Unit) -> None:
    """Draw each tip position with its residual, much enlarged."""
    points = ~fit.observations.turned
    figure, times = draw_vectors(
        fit.linearisation.position_mm[points], fit.linearisation.residual_mm[points], unit
    )
    page.add_heading("Residual vectors")
    page.add_figure(
        figure,
        f"At each tip position of the base frame its residual, {times:,.0f} times as long; the bar"
        " is a residual of the size named",
    )


def draw_signed_residuals(page: Page, fit: Identification, units: Units) -> None:
    """Draw the residuals along each joint's motion, and outwards over each sensor."""
    observations = fit.observations
    points = ~observations.turned
    states, residual_mm = observations.states, fit.linearisation.residual_mm[points]
    page.add_heading("Residuals against each joint and each sensor")
    page.add_figure(
        draw_residuals_by_joint(
            states.q[points], fit.linearisation.joints[points], residual_mm, units
        ),
        "Residual (tip minus target) along each joint's motion over its angle,"
        f" {units.angle.name}; orange: its running mean with the 95 % band of that mean",
    )
    by_sensor = draw_residuals_by_sensor(
        states.temperature_c[points], observations.arm.sensors,
        fit.linearisation.position_mm[points],
        residual_mm, units.length,
    )  # fmt: skip
    if by_sensor is not None:
        page.add_figure(
            by_sensor,
            f"Residual away from the base's z axis over each temperature, {units.length.name}",
        )

"""Measured against simulated residuals: those of a model, with those that noise alone would leave.

Each panel shows the mean residual (tip minus target) along one component over one variable. The
component is a joint's motion in ″, a link or an axis in µm, or the artefact's scale in µm/m. The
band contains 95 % of the data sets that are simulated from the model and the estimated noise; a few
of these sets are drawn, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from armd.compensation.diagnose.constants import CURVES
from armd.compensation.diagnose.predictive.curves import ResidualComparison, ResidualCurve
from armd.compensation.report.layout.drawing import COLOURS, make_figure
from armd.compensation.report.layout.units import MICROMETRES, SECONDS, Unit, Units

#: With more names than this there is no room for them below an axis.
MOST_LABELS = 24
ROW_IN = 2.3
GREY = "#8c959f"
UNITS = Units(MICROMETRES, SECONDS)


def draw_overview(comparisons: Sequence[ResidualComparison]) -> Figure:
    """Draw the comparisons outside their band most, of joint angles, temperatures, time and
    placements.

    Each is drawn under the model under test (left) and with the findings (right).
    """
    return draw_rows([*choose_overview(comparisons)])


def choose_overview(comparisons: Sequence[ResidualComparison]) -> Sequence[ResidualComparison]:
    """Choose the comparison of each group that is outside its band most under the model under test.

    The one that is so among all comparisons is added, if it belongs to none of the groups.
    """
    groups: dict[str, list[ResidualComparison]] = {}
    for comparison in comparisons:
        groups.setdefault(_get_group(comparison.bins.variable), []).append(comparison)
    order = ["joint angle", "temperature", "time", "placement"]
    if (
        comparisons
        and (first := _get_group(choose_most_outside(comparisons).bins.variable)) not in order
    ):
        order.insert(0, first)
    return [choose_most_outside(groups[group]) for group in order if group in groups]


def choose_most_outside(comparisons: Sequence[ResidualComparison]) -> ResidualComparison:
    """Return the comparison that exceeds the noise most under the model under test."""
    return min(comparisons, key=lambda comparison: comparison.order)


def choose_for_finding(
    comparisons: Sequence[ResidualComparison], finding: Mapping[str, Any]
) -> ResidualComparison | None:
    """Choose the comparison that shows a *finding* (of `diagnose --json`) best.

    It is over a variable that the finding depends on, at the finding's own place if there is one.
    Returns None if none of these variables was recorded.
    """
    names = {"approach" if name.startswith("approach") else name for name in finding["depends_on"]}
    over_its_variables = [
        comparison for comparison in comparisons if comparison.bins.variable in names
    ]
    at_place = [
        comparison
        for comparison in over_its_variables
        if comparison.component.place == finding["location"]
    ]
    candidates = at_place or over_its_variables
    return choose_most_outside(candidates) if candidates else None


def draw_rows(
    comparisons: Sequence[ResidualComparison], units: Units = UNITS, row_in: float = ROW_IN
) -> Figure:
    """Draw comparisons below each other: before (left), and after (right)."""
    figure, axes = make_figure(max(len(comparisons), 1), 2, row_in * max(len(comparisons), 1))
    for row, comparison in enumerate(comparisons):
        pair = axes[2 * row : 2 * row + 2]
        reach = (
            max(_compute_reach(comparison.before), _compute_reach(comparison.after))
            * get_unit(comparison, units).per_base
        )
        draw_curve(pair[0], comparison, comparison.before, "model under test", units)
        draw_curve(pair[1], comparison, comparison.after, "with the findings", units)
        for panel in pair:
            panel.set_ylim(-reach, reach)
    if comparisons:
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return figure


def draw_curve(
    panel: Axes,
    comparison: ResidualComparison,
    curve: ResidualCurve,
    name: str,
    units: Units = UNITS,
) -> None:
    """Draw one comparison under one model on *panel*."""
    unit = get_unit(comparison, units)
    bins, x = comparison.bins, comparison.bins.middle
    band, mean = curve.band * unit.per_base, curve.mean * unit.per_base
    panel.fill_between(
        x, -band, band, color=COLOURS[5], alpha=0.35, linewidth=0, label="noise, 95 %"
    )
    for values in curve.sets * unit.per_base:
        panel.plot(x, values, color=GREY, linewidth=0.5, alpha=0.6)
    line = "none" if bins.labels else "-"
    panel.plot(x, mean, color=COLOURS[0], linestyle=line, marker=".", label="measured")
    outside = np.abs(mean) > band
    panel.plot(x[outside], mean[outside], "o", color=COLOURS[1], markersize=4, label="outside")
    panel.axhline(0.0, color="black", linewidth=0.5)
    share, p = 100 * curve.outside, _format_p_value(curve)
    panel.set_title(f"{name}: {share:.0f} % outside, {p}", fontsize=9.0)
    panel.set(xlabel=bins.title, ylabel=f"residual, {comparison.component.title}, {unit.name}")
    if bins.labels:
        few = len(bins.labels) <= MOST_LABELS
        tick_labels = [_shorten_label(label) for label in bins.labels] if few else []
        panel.set_xticks(x if few else [], tick_labels, rotation=90, fontsize=7.0)


def get_unit(comparison: ResidualComparison, units: Units) -> Unit:
    """Return the unit of a comparison's residuals; a scale's is a length's per metre."""
    length = units.length
    match comparison.component.quantity:
        case "angle":
            return units.angle
        case "length":
            return length
    return Unit(f"{length.name}/m", 1e3 * length.per_base, length.decimals)


def _format_p_value(curve: ResidualCurve) -> str:
    """Format a p-value; one of 0 is stated as below the resolution of the drawn curves."""
    resolution = 1.0 / CURVES
    return f"p = {curve.p_value:.2g}" if curve.p_value >= resolution else f"p < {resolution:.1g}"


def _compute_reach(curve: ResidualCurve) -> float:
    largest = np.max([curve.band, np.abs(curve.mean)])
    return 1.1 * float(largest) + 1e-15


def _shorten_label(label: str) -> str:
    return label if len(label) <= 18 else f"…{label[-17:]}"


def _get_group(variable: str) -> str:
    if variable in ("time_s", "placement", "target", "approach"):
        return variable.removesuffix("_s")
    number = variable[1:].isdigit()
    if number and variable[0] == "q":
        return "joint angle"
    return "rate" if number and variable[0] == "w" else "temperature"

"""A picture of one finding: the readings, and the fitted effect over them.

If an effect changes one parameter and depends on one variable (a joint's angle error over its
angle), it is drawn in the parameter's own unit: fitted effect plus residual, reading by reading.
Any other effect is drawn as a length at the tip, along the effect's own direction. If it depends on
several variables, it is drawn over the fitted effect itself: readings that confirm it follow the
line.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from armd.arrays import F64, I64
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.problem.signatures import compile_candidates
from armd.compensation.effects.effect import Candidate
from armd.compensation.model import parameters
from armd.compensation.report.layout.drawing import (
    COLOURS,
    MOST_POINTS,
    draw_dots,
    make_single_figure,
)
from armd.compensation.report.layout.units import choose_units

BINS = 24
MOST_DOTS = 2500
#: Readings whose lever on the parameter is below this share of the median are not shown.
LEAST_LEVER = 0.3


def make_signature_plot(diagnosis: Diagnosis, index: int) -> Figure:
    """Make a figure of the readings for a finding, with the fitted effect over them."""
    figure, panel = make_single_figure()
    draw_signature(panel, diagnosis, index)
    return figure


def draw_signature(panel: Axes, diagnosis: Diagnosis, index: int) -> None:
    """Draw the readings for a finding, with the fitted effect over them."""
    candidate = diagnosis.search.last.findings[index]
    moved = {term.parameter for column in candidate.columns for term in column.terms}
    steady = all(column.artefact is None for column in candidate.columns)
    name, values = _get_variable(diagnosis, candidate)
    if len(candidate.depends_on) > 1:
        _, points, line, title = _project_at_tip(diagnosis, index)
        name = f"fitted effect at the tip, {choose_units(diagnosis.arm).length.name}"
        _draw(panel, line, points, line, name, title)
        panel.plot(*_compute_means(line, points), "o", color=COLOURS[2], label="readings, means")
        _add_legend(panel)
        return
    if len(moved) == 1 and candidate.depends_on and steady:
        rows, points, line, title = _project_on_parameter(diagnosis, index, next(iter(moved)))
    else:
        rows, points, line, title = _project_at_tip(diagnosis, index)
    _draw(panel, values[rows], points, line, name, title)
    if candidate.depends_on == ("target",):
        names = _list_target_names(diagnosis)
        panel.set_xticks(range(len(names)), names, rotation=90 if len(names) > BINS else 0)
    _add_legend(panel)


def _draw(panel: Axes, values: F64, points: F64, line: F64, name: str, title: str) -> None:
    indices = np.linspace(0, len(values) - 1, min(len(values), MOST_DOTS)).astype(int)
    label = "readings, all else taken off"
    draw_dots(panel, values[indices], points[indices], label)
    if len(np.unique(values)) <= BINS:
        panel.plot(*_compute_means(values, line), "o", color=COLOURS[1], label="fitted effect")
    else:
        panel.plot(*_make_curve(values, line), color=COLOURS[1], linewidth=2, label="fitted effect")
    panel.set(xlabel=name, ylabel=title, ylim=_choose_range(points, line))


def _add_legend(panel: Axes) -> None:
    panel.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)


def _project_on_parameter(
    diagnosis: Diagnosis, index: int, parameter: str
) -> tuple[I64, F64, F64, str]:
    """Return the rows with enough lever, their error of the parameter, the fitted one, and
    a title.
    """
    last = diagnosis.search.last
    n = last.linear.rests.n
    signatures = compile_candidates([last.findings[index]], last.linear, diagnosis.arm)
    effect = np.zeros(n)
    for parts, amplitude in zip(signatures.parts, last.amplitudes[index], strict=True):
        for _, weight, basis in parts:
            effect += amplitude * weight * signatures.bases[basis]
    effect -= effect.mean()  # a constant part belongs to the parameter itself
    number = diagnosis.arm.layout.index(parameter)
    lever = last.linear.jacobian[number, : 3 * n].reshape(n, 3)
    residual = (last.residual - last.fitted)[: 3 * n].reshape(n, 3)
    lever_squared = (lever**2).sum(axis=1)
    rows = np.flatnonzero(lever_squared > LEAST_LEVER**2 * np.median(lever_squared))
    # The residual is tip minus target: a parameter too small by e leaves −e times its column.
    error = effect - (residual * lever).sum(axis=1) / np.maximum(lever_squared, 1e-300)
    units = choose_units(diagnosis.arm)
    unit = units.length if parameters.find_unit(parameter) == "mm" else units.angle
    scale = unit.per_base
    joint = parameter.split("_")[-1]
    quantity = f"angle of joint {joint}" if parameter.startswith("theta") else parameter
    return (
        rows,
        scale * error[rows],
        scale * effect[rows],
        f"correction of the {quantity}, {unit.name}",
    )


def _project_at_tip(diagnosis: Diagnosis, index: int) -> tuple[I64, F64, F64, str]:
    """Return all rows, the residual before this finding along the effect, the effect, and
    a title.
    """
    last = diagnosis.search.last
    signature = last.net_signature(index)
    n = len(signature)
    residual = -(last.residual - last.fitted)[: 3 * n].reshape(n, 3)
    size = np.linalg.norm(signature, axis=1)
    direction = signature / np.maximum(size, 0.05 * max(float(np.median(size)), 1e-12))[:, None]
    axis = np.linalg.svd(signature, full_matrices=False)[2][0]
    sign = np.where(signature @ axis >= 0.0, 1.0, -1.0)
    before = ((residual + signature) * direction).sum(axis=1)
    rows = np.arange(n)
    unit = choose_units(diagnosis.arm).length
    scale, title = unit.per_base * sign, f"correction at the tip, along it, {unit.name}"
    return rows, before * scale, size * scale, title


def _make_curve(values: F64, line: F64) -> tuple[F64, F64]:
    """Make a curve of the effect over its variable, broken where nothing was measured."""
    order = np.argsort(values, kind="stable")
    thin = order[np.linspace(0, len(order) - 1, min(len(order), MOST_POINTS)).astype(int)]
    gaps = np.flatnonzero(np.diff(values[thin]) > np.ptp(values) / BINS) + 1
    return np.insert(values[thin], gaps, np.nan), np.insert(line[thin], gaps, np.nan)


def _compute_means(values: F64, points: F64) -> tuple[F64, F64]:
    """Compute means over the variable: for each value if there are few, else for groups of
    readings.
    """
    order = np.argsort(values, kind="stable")
    steps = np.flatnonzero(np.diff(values[order])) + 1
    few = len(steps) < BINS
    groups = np.array_split(order, steps if few else min(BINS, max(len(order) // 5, 1)))
    x = np.array([float(values[group].mean()) for group in groups])
    y = np.array([float(points[group].mean()) for group in groups])
    return x, y


def _choose_range(points: F64, line: F64) -> list[float]:
    """Choose a range with most of the readings and all of the effect.

    One stray reading must not compress both.
    """
    low, high = np.quantile(points, [0.005, 0.995])
    low, high = min(low, float(line.min())), max(high, float(line.max()))
    margin = 0.1 * (high - low) + 1e-12
    return [float(low - margin), float(high + margin)]


def _list_target_names(diagnosis: Diagnosis) -> list[str]:
    """List the artefact's targets in its own order, followed by further targets of
    other sessions.
    """
    return list(dict.fromkeys(diagnosis.search.last.linear.rests.target_label))


def _get_variable(diagnosis: Diagnosis, candidate: Candidate) -> tuple[str, F64]:
    """Return title and values of the first variable of the finding; else the reading's number."""
    rests = diagnosis.search.last.linear.rests
    states = rests.observations.states
    name = candidate.depends_on[0] if candidate.depends_on else ""
    if name[:1] == "q" and name[1:].isdigit():
        return f"joint {name[1:]}, °", np.degrees(states.q[:, int(name[1:]) - 1])
    if name[:1] == "w" and name[1:].isdigit():
        return f"rate of joint {name[1:]}, rad/s", states.rate[:, int(name[1:]) - 1]
    if name in diagnosis.arm.sensors:
        column = states.temperature_c[:, diagnosis.arm.sensors.index(name)]
        return f"{name}, °C", column
    if name == "time_s":
        hours = (states.time_s - states.time_s.min()) / 3600
        return "time since the first reading, h", hours
    if name == "artefact_c":
        return "artefact above its reference, K", rests.artefact_rise_c
    if name == "target":
        place = {label: i for i, label in enumerate(_list_target_names(diagnosis))}
        labels = [rests.target_label[i] for i in rests.observations.target]
        return "target", np.array([place[label] for label in labels], dtype=np.float64)
    if name.startswith("approach_"):
        return name, states.approach[:, "xyz".index(name[-1])]
    return "reading, number", np.arange(rests.n, dtype=float)

"""The repeatability of an arm as one HTML page with one picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from armd.arrays import F64
from armd.compensation.report.layout.drawing import COLOURS, make_figure
from armd.compensation.report.layout.page import Page, make_report_number
from armd.compensation.report.sessions import InputFile
from armd.compensation.verify.repeatability import Repeatability


def make_repeatability_page(
    repeatability: Repeatability,
    words: Sequence[str],
    time_and_temperature: tuple[F64, F64],
    name: str,
    files: Mapping[str, InputFile | None],
) -> str:
    """Make the page as HTML text.

    *time_and_temperature* are hours and °C of the visits, *name* is that of the measured object.
    """
    page = Page(f"Repeatability: {name}")
    page.add_items(words)
    page.add_figure(
        _draw_over_time(repeatability, *time_and_temperature),
        "Each visit's distance from the mean in x, y and z, the fitted drifts (lines), and the"
        " temperature",
    )
    inputs = {f"{role} {file.name}": file.sha256 for role, file in files.items() if file}
    page.add_origin(make_report_number(name, *inputs.values()), inputs)
    page.add_signature_lines("Measured by", "Checked by")
    return page.to_html()


def _draw_over_time(repeatability: Repeatability, time_h: F64, temperature_c: F64) -> Figure:
    """Draw the visits over hours, or over their number if no time is known."""
    warm, timed = np.isfinite(temperature_c).any(), np.isfinite(time_h).all()
    across = time_h if timed else np.arange(1.0, len(time_h) + 1)
    figure, panels = make_figure(1 + bool(warm), 1, 5.0 if warm else 3.6)
    for i, axis in enumerate("xyz"):
        panels[0].plot(across, repeatability.offset_um[:, i], ".", color=COLOURS[i], label=axis)
        panels[0].plot(across, repeatability.fitted_um[:, i], color=COLOURS[i], linewidth=0.9)
    panels[0].set_ylabel("from the mean, µm")
    panels[0].legend(frameon=False, ncols=3)
    if warm:
        panels[1].plot(across, temperature_c, ".-", color=COLOURS[6], linewidth=0.6)
        panels[1].set_ylabel("temperature, °C")
    panels[-1].set_xlabel("time, h" if timed else "visit")
    return figure

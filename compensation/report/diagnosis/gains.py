"""A drawing of the held-out error as one finding after another is added."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes

from armd.compensation.report.layout.units import MICROMETRES, Unit

#: With more findings than this, their names would overlap.
MOST_NAMED = 5


def name_finding(finding: Mapping[str, Any]) -> str:
    """Return a finding's cause and place, as `diagnose --json` has it, in words."""
    cause_names_place = finding["location"] == "-" or finding["cause"].startswith(
        finding["location"]
    )
    place = "" if cause_names_place else f", {finding['location']}"
    return f"{finding['cause'].replace('_', ' ')}{place}"


def draw_gains(panel: Axes, result: Mapping[str, Any], unit: Unit = MICROMETRES) -> None:
    """Draw the held-out 3-D RMS, before and after each finding of *result* (`diagnose --json`).

    Whiskers are 95 % of its gain; the dotted line is the noise alone.
    """
    baseline = result["baseline"]
    labels, values = ["model under test"], [baseline["heldout_rms_um"]]
    low, high = [0.0], [0.0]
    for number, finding in enumerate(result["findings"], 1):
        gain = finding["gain"]
        labels.append(f"+ {number}. " + name_finding(finding).replace(", ", "\n"))
        values.append(gain["heldout_rms_um_after"])
        best, worst = (gain["heldout_rms_um_before"] - g for g in reversed(gain["interval_um"]))
        low.append(max(values[-1] - best, 0.0))
        high.append(max(worst - values[-1], 0.0))
    factor = unit.per_base / 1e3
    values, low, high = ([factor * number for number in row] for row in (values, low, high))
    places = range(len(labels))
    panel.errorbar(places, values, yerr=[low, high], fmt="o", capsize=4)
    for place, value in zip(places, values, strict=True):
        panel.annotate(
            f"{value:.{unit.decimals}f}", (place, value), xytext=(7, 0), textcoords="offset points"
        )
    short = len(labels) > MOST_NAMED  # the table above lists their names
    panel.set_xticks(places, [f"+ {i}." if i else labels[0] for i in places] if short else labels)
    panel.set_xlim(-0.5, len(labels) - 0.5)
    panel.set_ylim(
        0.0, 1.15 * max(value + whisker for value, whisker in zip(values, high, strict=True))
    )
    floor = factor * baseline["noise_floor_um"]
    panel.axhline(floor, linestyle=":", color="black")
    panel.annotate(
        "noise alone", (1.0, floor), xycoords=("axes fraction", "data"),
        ha="right", va="bottom", bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7},
    )  # fmt: skip
    panel.set_ylabel(f"3-D RMS held-out, {unit.name}")

"""What one finding after another gains on held-out readings, as points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes

from armd.compensation.diagnose.told.verdict import um


def name_finding(finding: Mapping[str, Any]) -> str:
    """A finding's cause and place, as `diagnose --json` has it, in words."""
    said = finding["location"] == "-" or finding["cause"].startswith(finding["location"])
    place = "" if said else f", {finding['location']}"
    return f"{finding['cause'].replace('_', ' ')}{place}"


def draw_gains(panel: Axes, result: Mapping[str, Any]) -> None:
    """Draw held-out 3-D RMS in µm, before and after each finding of *result* (`diagnose --json`);
    whiskers are 95 % of its gain, the dotted line is the noise alone."""
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
    places = range(len(labels))
    panel.errorbar(places, values, yerr=[low, high], fmt="o", capsize=4)
    for place, value in zip(places, values, strict=True):
        panel.annotate(um(value), (place, value), xytext=(7, 0), textcoords="offset points")
    panel.set_xticks(places, labels)
    panel.set_xlim(-0.5, len(labels) - 0.5)
    panel.set_ylim(0.0, 1.15 * max(value + more for value, more in zip(values, high, strict=True)))
    panel.axhline(baseline["noise_floor_um"], linestyle=":", color="black")
    panel.annotate(
        "noise alone", (1.0, baseline["noise_floor_um"]), xycoords=("axes fraction", "data"),
        ha="right", va="bottom", bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7},
    )  # fmt: skip
    panel.set_ylabel("3-D RMS held-out, µm")

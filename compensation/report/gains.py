"""What one finding after another gains on held-out readings, as bars."""

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
    bars = panel.bar(labels, values, width=0.55, yerr=[low, high], capsize=4)
    panel.bar_label(bars, [um(value) for value in values], label_type="center", color="white")
    panel.axhline(baseline["noise_floor_um"], linestyle=":", color="black")
    panel.annotate(
        "noise alone", (1.0, baseline["noise_floor_um"]), xycoords=("axes fraction", "data"),
        ha="right", va="bottom", bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7},
    )  # fmt: skip
    panel.set_ylabel("3-D RMS on held-out readings, µm")

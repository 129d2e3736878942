"""One finding of a diagnosis on the page: its gain, its signature in the readings, its rivals."""

from __future__ import annotations

from typing import Any

import numpy as np

from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.report.diagnosis.gains import name_finding
from armd.compensation.report.diagnosis.signature_plot import make_signature_plot
from armd.compensation.report.layout.page import Page
from armd.compensation.report.layout.units import choose_units
from armd.compensation.report.sessions import NOT_STATED
from armd.compensation.wording import ARC_SECOND, format_clock

#: Units in which the page shows amplitudes.
SMALL = {"rad": (1.0 / ARC_SECOND, "″"), "mm": (1e3, "µm")}


def add_finding(
    page: Page, diagnosis: Diagnosis, index: int, number: int, finding: dict[str, Any]
) -> None:
    """Add a finding with the number that it has in the verdict."""
    page.add_heading(f"{number}. {name_finding(finding)}")
    page.add_text(_to_sentence(finding["reading"]))
    gain, length = finding["gain"], choose_units(diagnosis.arm).length

    def format_um(value_um: float) -> str:
        return length.to_text(value_um / 1e3)

    low, high = gain["interval_um"]
    page.add_text(
        f"Held-out readings: {format_um(gain['heldout_rms_um_before'])} before, "
        f"{format_um(gain['heldout_rms_um_after'])} after (95 % of the gain: {format_um(low)} to"
        f" {format_um(high)})."
        + ("" if gain["shown"] else " They do not confirm it: a lead to follow, not a fact.")
    )
    page.add_text(
        f"Why: {finding['reason']}. In these readings it moves the tip by "
        f"{format_um(finding['tip_rms_um'])} (3-D RMS) that nothing else in the model takes up, "
        f"{finding['signal_to_noise']:.1f} standard deviations out of the noise."
    )
    page.add_figure(
        make_signature_plot(diagnosis, index),
        f"What the readings show of {name_finding(finding)}, without everything else, and the fit",
    )
    _add_evidence(page, finding)
    _add_predictive_checks(page, finding)
    _add_amplitudes(page, finding)


def _to_sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _add_evidence(page: Page, finding: dict[str, Any]) -> None:
    if not finding["alternatives"]:
        page.add_text(f"No other cause comes near (probability {finding['probability']:.3f}).")
        return
    rows = [[_name_cause(finding), finding["location"], f"{finding['probability']:.3f}", ""]]
    rows += [
        [_name_cause(a), a["location"], f"{a['probability']:.3f}", f"{a['angle_deg']:.0f}°"]
        for a in finding["alternatives"]
    ]
    page.add_table(["cause", "where", "probability", "angle between signatures"], rows)
    page.add_text(f"Easily confused with each other: {finding['confounded_with']}.")


def _add_predictive_checks(page: Page, finding: dict[str, Any]) -> None:
    """Add the predictive checks: the amplitude in parts of the readings."""
    explains = finding["explains"]
    if not explains or not explains["checks"]:
        return
    on = f" of what depends on {', '.join(explains['of'])}" if explains["of"] else ""
    page.add_text(
        f"It accounts for {100 * explains['share']:.0f} %{on}. Its amplitude in parts of the "
        "readings, as a share of that in all of them (± standard uncertainty):"
    )
    rows = []
    for check in explains["checks"]:
        parts = [
            f"{p['part']}: {p['amplitude_ratio']:.2f} ± {p['standard_uncertainty']:.2g}"
            for p in check["parts"]
        ]
        rows.append([check["by"], "; ".join(parts), f"{check['p_value']:.2g}"])
    page.add_table(["separated by", "amplitude", "p that it is the same"], rows)


def _name_cause(row: dict[str, Any]) -> str:
    return str(row["cause"].replace("_", " "))


def _add_amplitudes(page: Page, finding: dict[str, Any]) -> None:
    page.add_table(
        ["amplitude", "value", "standard uncertainty", "unit"],
        [_format_small_units(parameter) for parameter in finding["parameters"]],
    )


def _format_small_units(parameter: dict[str, Any]) -> list[str]:
    """Format angles in seconds of arc and lengths in µm; an uncertainty only if it is stated."""
    if parameter["unit"] == "s (Unix)":
        return [parameter["name"], format_clock(parameter["value"]), NOT_STATED, ""]
    scale, unit = SMALL.get(parameter["unit"].split(" ")[0].split("/")[0], (1.0, ""))
    per_unit = parameter["unit"].removeprefix(parameter["unit"].split(" ")[0].split("/")[0])
    if per_unit == "/rad":  # the plot above has its axis in degrees
        scale, per_unit = scale * float(np.radians(1.0)), "/°"
    value, sigma = scale * parameter["value"], scale * parameter["standard_uncertainty"]
    shown_unit = unit + per_unit if unit else parameter["unit"]
    if not sigma:
        return [parameter["name"], f"{value:.10g}", NOT_STATED, shown_unit]
    digits = max(0, 1 - int(np.floor(np.log10(sigma))))
    fine = f"{value:.{digits}f}" if digits < 6 else f"{value:.4g}"
    return [parameter["name"], fine, f"{sigma:.2g}", shown_unit]

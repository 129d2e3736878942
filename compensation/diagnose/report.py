"""The diagnosis as one self-contained HTML file that opens offline."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go

from armd.compensation.diagnose.diagnose import Diagnosis
from armd.compensation.diagnose.result import place_of
from armd.compensation.effects.effect import Candidate
from armd.compensation.report.page import Page

F64 = npt.NDArray[np.float64]

BINS = 24


def diagnosis_report(diagnosis: Diagnosis, result: dict[str, Any]) -> str:
    """The page; *result* is the diagnosis as its JSON has it."""
    page = Page(f"Diagnosis of {diagnosis.arm.serial_number}")
    _at_a_glance(page, diagnosis, result)
    for index, found in enumerate(diagnosis.found):
        finding = result["findings"][index]
        page.heading(f"{index + 1}. {finding['cause']}, {finding['location']}")
        page.text(finding["reading"] + ".")
        page.text(
            f"Why: {finding['reason']}. It moves the tip by {finding['tip_rms_um']:.2f} µm (3-D "
            f"RMS) in these readings; its signature stands {finding['signal_to_noise']:.1f} "
            "standard deviations out of the noise."
        )
        _evidence(page, finding)
        _amplitudes(page, finding)
        _signature(page, diagnosis, index, found.candidate)
    if diagnosis.outliers:
        page.heading("Readings that belong to no effect")
        page.table(
            ["session", "row", "error, µm"],
            [[o.session, o.row, f"{o.error_um:.1f}"] for o in diagnosis.outliers],
        )
    _what_stays(page, diagnosis, result)
    page.heading("Next experiment")
    page.text(result["next_experiment"])
    return page.html()


def _at_a_glance(page: Page, diagnosis: Diagnosis, result: dict[str, Any]) -> None:
    baseline = result["baseline"]
    page.text(
        f"{sum(s.n for s in diagnosis.sessions)} readings in {len(diagnosis.sessions)} sessions. "
        f"Model under test: {'the calibration given' if diagnosis.baseline.held else 'what'}"
        f"{'' if diagnosis.baseline.held else ' armd calibrate makes of the same sessions'}. "
        f"Held out: {'other sessions' if diagnosis.holdout else 'each placement in turn'}."
    )
    labels, values = ["model under test"], [baseline["heldout_rms_um"]]
    low, high = [0.0], [0.0]
    for finding in result["findings"]:
        gain = finding["gain"]
        labels.append(f"+ {finding['cause']}<br>{finding['location']}")
        values.append(gain["heldout_rms_um_after"])
        best, worst = (gain["heldout_rms_um_before"] - g for g in reversed(gain["interval_um"]))
        low.append(max(values[-1] - best, 0.0))
        high.append(max(worst - values[-1], 0.0))
    error = {"type": "data", "array": high, "arrayminus": low, "symmetric": False}
    figure = go.Figure(go.Bar(x=labels, y=values, error_y=error))
    figure.add_hline(y=baseline["noise_floor_um"], line_dash="dot", annotation_text="noise alone")
    figure.update_yaxes(title="3-D RMS on held-out readings, µm", rangemode="tozero")
    page.figure(figure)
    if not result["findings"]:
        page.text("Nothing significant was found: the residuals are what the noise makes of them.")


def _evidence(page: Page, finding: dict[str, Any]) -> None:
    rows = [[finding["cause"], finding["location"], f"{finding['probability']:.3f}", ""]]
    rows += [
        [a["cause"], a["location"], f"{a['probability']:.3f}", f"{a['angle_deg']:.0f}°"]
        for a in finding["alternatives"]
    ]
    page.table(["cause", "where", "probability", "angle between signatures"], rows)
    if finding["alternatives"]:
        page.text(f"Easily taken for each other: {finding['confounded_with']}.")


def _amplitudes(page: Page, finding: dict[str, Any]) -> None:
    page.table(
        ["amplitude", "value", "standard uncertainty", "unit"],
        [
            [p["name"], f"{p['value']:.6g}", f"{p['standard_uncertainty']:.2g}", p["unit"]]
            for p in finding["parameters"]
        ],
    )


def _signature(page: Page, diagnosis: Diagnosis, index: int, candidate: Candidate) -> None:
    """Residuals along the finding's own direction, against the variable that matters."""
    last = diagnosis.search.last
    n = last.linear.rests.n
    signature = -(last.absorbing.columns[:, last.layout.findings[index]] @ last.amplitudes[index])
    signature = signature[: 3 * n].reshape(n, 3)
    left = (last.residual - last.fitted)[: 3 * n].reshape(n, 3)
    size = np.linalg.norm(signature, axis=1)
    middle = max(float(np.median(size)), 1e-12)
    # One number per reading: the residual before this finding, seen along its signature.
    along = ((left - signature) * signature).sum(axis=1) / np.maximum(size, 0.05 * middle)
    sign = _sign(signature)
    name, values, unit = _variable(diagnosis, candidate)
    figure = go.Figure()
    figure.add_scatter(
        x=values, y=-1e3 * along * sign, mode="markers", name="residual without it",
        marker={"size": 4, "opacity": 0.5},
    )  # fmt: skip
    order = np.argsort(values)
    groups = np.array_split(order, min(BINS, max(len(order) // 5, 1)))
    figure.add_scatter(
        x=[float(values[g].mean()) for g in groups],
        y=[1e3 * float((size * sign)[g].mean()) for g in groups],
        mode="lines+markers",
        name="fitted signature, mean",
    )
    figure.update_xaxes(title=f"{name}, {unit}" if unit else name)
    figure.update_yaxes(title="along the signature, µm")
    page.figure(figure)


def _sign(signature: F64) -> F64:
    """Which way a signature points, along the direction it varies most in."""
    axis = np.linalg.svd(signature, full_matrices=False)[2][0]
    sign: F64 = np.where(signature @ axis >= 0.0, 1.0, -1.0)
    return sign


def _variable(diagnosis: Diagnosis, candidate: Candidate) -> tuple[str, F64, str]:
    """Values of the first variable the finding depends on; the reading's number otherwise."""
    rests = diagnosis.search.last.linear.rests
    states = rests.observations.states
    name = candidate.depends_on[0] if candidate.depends_on else ""
    if name[:1] == "q" and name[1:].isdigit():
        return name, np.degrees(states.q[:, int(name[1:]) - 1]), "°"
    if name[:1] == "w" and name[1:].isdigit():
        return name, states.rate[:, int(name[1:]) - 1], "rad/s"
    if name in diagnosis.arm.sensors:
        return name, states.temperature_c[:, diagnosis.arm.sensors.index(name)], "°C"
    if name == "time_s":
        return "time since the first reading", (states.time_s - states.time_s.min()) / 3600, "h"
    if name == "artefact_c":
        return "artefact above its reference", rests.artefact_rise_c, "K"
    if name == "target":
        return "target", rests.observations.target.astype(float), "number"
    if name.startswith("approach_"):
        return name, states.approach[:, "xyz".index(name[-1])], ""
    return "reading", np.arange(rests.n, dtype=float), "number"


def _what_stays(page: Page, diagnosis: Diagnosis, result: dict[str, Any]) -> None:
    page.heading("What stays unexplained")
    unexplained = result["unexplained"]
    page.text(
        f"{diagnosis.remaining_rms_um:.2f} µm 3-D RMS stay, of which the noise accounts for "
        f"{diagnosis.noise_floor_um:.2f} µm. "
        + (
            f"What is left is significant and depends on {', '.join(unexplained['depends_on'])}."
            if unexplained["significant"]
            else "Nothing in it is significant "
            f"(p = {diagnosis.search.remaining_p:.2g} for the strongest of all candidates)."
        )
    )
    noise = diagnosis.search.last.noise
    page.table(
        ["noise found in these readings", "standard deviation"],
        [
            ["encoders, each", f"{np.degrees(noise.encoder_rad) * 3600:.2f}″"],
            ["repeat of a point, each axis", f"{noise.repeat_mm * 1e3:.2f} µm"],
            ["slow drift of the base, each axis", f"{noise.drift_mm * 1e3:.2f} µm"],
        ],
    )
    page.table(
        ["finding", "where"], [[f.candidate.cause, place_of(f.candidate)] for f in diagnosis.found]
    )

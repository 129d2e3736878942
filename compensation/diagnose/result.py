"""A diagnosis as `armd diagnose --json` writes it (docs: the contract's section 4)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from armd.compensation.diagnose.diagnose import Diagnosis
from armd.compensation.diagnose.fit import is_curve
from armd.compensation.diagnose.gain import Gain
from armd.compensation.diagnose.next import next_experiment
from armd.compensation.diagnose.search import Found
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Candidate

F64 = npt.NDArray[np.float64]


def as_json(diagnosis: Diagnosis, extended_path: str | None) -> dict[str, Any]:
    """The whole result as plain data."""
    findings = [
        _finding(diagnosis, i, found, gain)
        for i, (found, gain) in enumerate(zip(diagnosis.found, diagnosis.gains, strict=True))
    ]
    if diagnosis.outliers and diagnosis.outlier_gain is not None:
        findings.append(_outliers(diagnosis, diagnosis.outlier_gain))
    unexplained = max(diagnosis.remaining_rms_um**2 - diagnosis.noise_floor_um**2, 0.0)
    return {
        "schema": "armd.diagnosis/1",
        "baseline": {
            "rms_um": diagnosis.rms_um,
            "heldout_rms_um": diagnosis.heldout_rms_um,
            "noise_floor_um": diagnosis.noise_floor_um,
            "calibration_given": diagnosis.baseline.held,
            "heldout_by": "session" if diagnosis.holdout else "placement, in turn",
        },
        "findings": findings,
        "unexplained": {
            "rms_um": float(np.sqrt(unexplained)),
            "significant": diagnosis.significant_rest,
            "depends_on": list(diagnosis.search.remaining_depends_on)
            if diagnosis.significant_rest
            else [],
        },
        "verdict": verdict(diagnosis),
        "cannot_tell": [
            {"cause": cause, "needs": needs_of(cause), "experiment": CATALOGUE[cause].experiment}
            for cause in diagnosis.search.untold
        ],
        "extended_calibration": extended_path,
        "next_experiment": next_experiment(diagnosis),
    }


def verdict(diagnosis: Diagnosis) -> str:
    """What came of it, in a sentence or two."""
    sentences = []
    shown = [gain.shown for gain in diagnosis.gains]
    if not shown:
        sentences.append("No cause was found.")
    elif not any(shown):
        sentences.append(
            f"{_count(len(shown), 'finding')}, but held-out readings do not improve beyond doubt: "
            "leads to follow, no reason yet to run the extended calibration."
        )
    else:
        before, after = diagnosis.gains[0].before_um, diagnosis.gains[-1].after_um
        sentences.append(
            f"{_count(len(shown), 'finding')}; with the extended model held-out readings err by "
            f"{after:.4g} µm instead of {before:.4g} µm (3-D RMS)."
        )
        if not all(shown):
            doubtful = ", ".join(str(i) for i, yes in enumerate(shown, 1) if not yes)
            sentences.append(f"They do not bear out number {doubtful}.")
    if diagnosis.significant_rest:
        on = ", ".join(diagnosis.search.remaining_depends_on) or "nothing that was recorded"
        sentences.append(f"Something significant is left; it depends on {on}.")
    elif not shown and not diagnosis.outliers:
        sentences.append("The residuals are what the noise makes of them.")
    return " ".join(sentences)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def needs_of(cause: str) -> str:
    """What sessions must hold for a cause to show at all."""
    return (
        CATALOGUE[cause].needs or "poses or conditions that set it apart from placements and seats"
    )


def _finding(diagnosis: Diagnosis, index: int, found: Found, gain: Gain) -> dict[str, Any]:
    candidate = found.candidate
    last = diagnosis.search.last
    amplitudes, covariance = last.amplitudes[index], last.covariances[index]
    effect = CATALOGUE[candidate.cause]
    return {
        "cause": candidate.cause,
        "location": place_of(candidate),
        "parameters": parameters_of(candidate, amplitudes, covariance),
        "probability": found.probability,
        "p_value": found.p_value,
        "alternatives": [
            {
                "cause": rival.candidate.cause,
                "location": place_of(rival.candidate),
                "probability": rival.probability,
                "angle_deg": rival.angle_deg,
            }
            for rival in found.rivals
        ],
        "gain": _gain(gain),
        "depends_on": list(candidate.depends_on),
        "signal_to_noise": float(np.sqrt(found.statistic)),
        "tip_rms_um": tip_rms_um(diagnosis, index),
        "reading": effect.reading(candidate, amplitudes),
        "reason": effect.reason,
        "confounded_with": effect.confounded_with,
    }


def place_of(candidate: Candidate) -> str:
    """The location as the contract has it: nothing is claimed of what is unknown."""
    return "-" if candidate.cause == "unknown" else candidate.location


def parameters_of(
    candidate: Candidate, amplitudes: F64, covariance: F64
) -> list[dict[str, str | float]]:
    """Amplitudes with standard uncertainties, then what was scanned (order, instant, …)."""
    rows: list[dict[str, str | float]] = []
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if is_curve(candidate):
        power = (amplitudes.reshape(-1, 2) ** 2).sum(axis=1)
        size = float(np.sqrt(power.sum() / 2))
        along = amplitudes / max(float(np.linalg.norm(amplitudes)), 1e-300)
        spread = float(np.sqrt(along @ covariance @ along / 2))
        rows.append(_row("rms", size, "rad", spread))
        rows.append(_row("order", float(3 + np.argmax(power)), "1/turn", 0.0))
    else:
        rows += [
            _row(column.name, float(value), column.unit, float(s))
            for column, value, s in zip(candidate.columns, amplitudes, sigma, strict=True)
        ]
    rows += [_row(name, value, unit, 0.0) for name, value, unit in candidate.setting]
    return rows


def _row(name: str, value: float, unit: str, sigma: float) -> dict[str, str | float]:
    return {"name": name, "value": value, "unit": unit, "standard_uncertainty": sigma}


def tip_rms_um(diagnosis: Diagnosis, index: int) -> float:
    """How far the effect moves the tip in these readings, 3-D RMS in µm: what placements,
    constants and the other findings cannot take up."""
    moves = diagnosis.search.last.net_signature(index)
    return 1e3 * float(np.sqrt((moves**2).sum() / max(len(moves), 1)))


def _gain(gain: Gain) -> dict[str, Any]:
    return {
        "heldout_rms_um_before": gain.before_um,
        "heldout_rms_um_after": gain.after_um,
        "interval_um": list(gain.interval_um),
        "shown": gain.shown,
    }


def _outliers(diagnosis: Diagnosis, gain: Gain) -> dict[str, Any]:
    effect = CATALOGUE["outliers"]
    rows = diagnosis.outliers
    return {
        "cause": "outliers",
        "location": "rows",
        "parameters": [_row("count", float(len(rows)), "1", 0.0)],
        "rows": [{"session": o.session, "row": o.row, "error_um": o.error_um} for o in rows],
        "probability": 1.0 - diagnosis.outlier_p,
        "p_value": diagnosis.outlier_p,
        "alternatives": [],
        "gain": _gain(gain),
        "depends_on": [],
        "reading": effect.reading(Candidate("outliers", "rows", (), ()), np.zeros(len(rows))),
        "reason": effect.reason,
        "confounded_with": effect.confounded_with,
    }

"""The result of a diagnosis as `armd diagnose --json` writes it (docs: contract, section 4)."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from armd.compensation.diagnose.constants import MOST_PARTS
from armd.compensation.diagnose.diagnosis import Diagnosis, Explained, Finding, Gain, MovedArtefact
from armd.compensation.diagnose.fitting.target_steps import TargetStep, measure_target_steps
from armd.compensation.diagnose.problem.amplitudes import is_curve
from armd.compensation.diagnose.report.advice import propose_experiment
from armd.compensation.diagnose.report.sets import CauseSet, list_sets
from armd.compensation.diagnose.report.sizes import (
    compute_tip_rms_um,
    is_size_known,
    list_parameters,
    make_row,
    measure_curve,
)
from armd.compensation.diagnose.report.verdict import describe_moved, write_verdict
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.location import ROWS


def as_json(diagnosis: Diagnosis, extended_path: str | None) -> dict[str, Any]:
    """Return the whole result as plain data."""
    findings = [
        _finding(diagnosis, i, finding, gain)
        for i, (finding, gain) in enumerate(zip(diagnosis.findings, diagnosis.gains, strict=True))
    ]
    findings = [*(_touched(diagnosis, step) for step in diagnosis.touched), *findings]
    if diagnosis.outliers and diagnosis.outlier_gain is not None:
        findings.append(_outliers(diagnosis, diagnosis.outlier_gain))
    search = diagnosis.search
    sets = list_sets(
        diagnosis.findings, search.rival_causes, search.further_causes, search.further_odds
    )
    unexplained = max(diagnosis.remaining_rms_um**2 - diagnosis.noise_floor_um**2, 0.0)
    return {
        "schema": "armd.diagnosis/1",
        "baseline": {
            "rms_um": diagnosis.rms_um,
            "heldout_rms_um": diagnosis.heldout_rms_um,
            "noise_floor_um": diagnosis.noise_floor_um,
            "calibration_given": diagnosis.baseline.is_given,
            "heldout_rms_um_extended": diagnosis.written_rms_um[1],
            "later_gain_um": diagnosis.later_gain_um and list(diagnosis.later_gain_um),
            "heldout_by": "session" if diagnosis.holdout else "placement, in turn",
        },
        "findings": findings,
        "sets": [_describe_set(causes) for causes in sets],
        "unexplained": {
            "rms_um": float(np.sqrt(unexplained)),
            "significant": diagnosis.significant_rest,
            "depends_on": list(diagnosis.search.remaining_depends_on)
            if diagnosis.significant_rest
            else [],
            "by_target": [
                asdict(step) for step in _limit_steps(measure_target_steps(diagnosis.search.last))
            ],
        },
        "noise": {
            name: float(getattr(diagnosis.search.last.noise, name))
            for name in ("encoder_rad", "repeat_mm", "drift_mm")
        },
        "readings": {"told": list(diagnosis.remarks)},
        "skipped": list(diagnosis.skipped),
        "verdict": write_verdict(diagnosis),
        "cannot_tell": [
            {
                "cause": cause,
                "needs": describe_needs(cause),
                "experiment": CATALOGUE[cause].experiment,
            }
            for cause in diagnosis.search.untold
        ],
        "would_show": [
            {"cause": cause, "signal_to_noise_at_typical_size": snr}
            for cause, snr in sorted(diagnosis.search.would_show.items())
        ],
        "extended_calibration": extended_path,
        "next_experiment": propose_experiment(diagnosis),
    }


def _limit_steps(target_steps: list[TargetStep]) -> list[TargetStep]:
    """Return the steps of targets, or none where there are too many to read."""
    return target_steps if len(target_steps) <= MOST_PARTS else []


def describe_needs(cause: str) -> str:
    """Describe what sessions must contain for a cause to show at all."""
    return (
        CATALOGUE[cause].needs or "poses or conditions that set it apart from placements and seats"
    )


def _describe_set(cause_set: CauseSet) -> dict[str, Any]:
    return {
        "causes": [
            {"cause": cause.cause, "location": describe_place(cause)} for cause in cause_set.causes
        ],
        "probability": cause_set.probability,
    }


def _finding(diagnosis: Diagnosis, index: int, finding: Finding, gain: Gain) -> dict[str, Any]:
    candidate = finding.candidate
    effect = CATALOGUE[candidate.cause]
    return {
        "cause": candidate.cause,
        "location": describe_place(candidate),
        "parameters": list_parameters(diagnosis, index),
        "probability": finding.probability,
        "p_value": finding.p_value,
        "alternatives": [
            {
                "cause": rival.candidate.cause,
                "location": describe_place(rival.candidate),
                "probability": rival.probability,
                "angle_deg": rival.angle_deg,
            }
            for rival in finding.rivals
        ],
        "gain": _gain(gain),
        "size_known": is_size_known(diagnosis, index),
        "in_extended_calibration": index in diagnosis.written,
        "depends_on": list(candidate.depends_on),
        "signal_to_noise": float(np.sqrt(finding.statistic)),
        "tip_rms_um": compute_tip_rms_um(diagnosis, index),
        "explains": _explains(finding.explained),
        "reading": describe_finding(diagnosis, index),
        "reason": effect.reason,
        "confounded_with": effect.confounded_with,
    }


def _explains(explained: Explained | None) -> dict[str, Any] | None:
    """Return how much a cause accounts for, and whether its amplitude is equal everywhere."""
    if explained is None:
        return None
    return {
        "share": explained.share,
        "of": list(explained.variables),
        "guess": explained.guess,
        "checks": [
            {
                "by": check.by,
                "p_value": check.p_value,
                "parts": [
                    {"part": part, "amplitude_ratio": float(r), "standard_uncertainty": float(s)}
                    for part, r, s in zip(check.parts, check.ratio, check.sigma, strict=True)
                ],
            }
            for check in explained.checks
        ],
    }


def describe_place(candidate: Candidate) -> str:
    """Return the location as the contract defines it: for an unknown cause none is claimed."""
    return "-" if candidate.cause == "unknown" else str(candidate.location)


def describe_finding(diagnosis: Diagnosis, index: int) -> str:
    """Describe in words what the amplitudes mean."""
    candidate = diagnosis.search.last.findings[index]
    of_curve = CATALOGUE[candidate.cause].describe_curve
    if of_curve is not None and is_curve(candidate):
        rms, _, order = measure_curve(diagnosis, index)
        return of_curve(candidate, rms, order)
    finding = diagnosis.findings[index]
    effect = CATALOGUE[finding.candidate.cause]
    text = effect.describe(candidate, diagnosis.search.last.amplitudes[index])
    if finding.is_of_several_names:
        text = (
            f"a structure in {', '.join(candidate.depends_on)} that more than one cause of the "
            "catalogue makes, and these readings do not tell which"
        )
    if effect.by_weight and any(joint.mass_kg is None for joint in diagnosis.arm.joint):
        text += " (masses that arm.toml does not give are assumed)"
    explained = finding.explained
    if explained is not None and explained.guess and effect.cause != "unknown":
        on = " and ".join(explained.variables) or "the readings"
        share = f"{100 * explained.share:.0f} %"
        text += f"; it explains {share} of what depends on {on}: the name is a guess"
    if not is_size_known(diagnosis, index):
        text += "; this size is within its own uncertainty, and not to be relied on"
    return text


def _gain(gain: Gain) -> dict[str, Any]:
    without_outliers = gain.without_outliers_um
    return {
        **({"heldout_rms_um_without_outliers": list(without_outliers)} if without_outliers else {}),
        "heldout_rms_um_before": gain.before_um,
        "heldout_rms_um_after": gain.after_um,
        "interval_um": list(gain.interval_um),
        "shown": gain.is_confirmed,
    }


def _touched(diagnosis: Diagnosis, touched: MovedArtefact) -> dict[str, Any]:
    effect = CATALOGUE["artefact_moved"]
    assert diagnosis.touched_gain is not None
    rows = [
        make_row(column.name, float(value), column.unit, float(sigma))
        for column, value, sigma in zip(
            touched.candidate.columns, touched.amplitudes, touched.uncertainties, strict=True
        )
    ]
    return {
        "cause": "artefact_moved",
        "location": "artefact",
        "parameters": [*rows, make_row("instant", touched.instant_unix_s, "s (Unix)", 0.0)],
        "session": touched.session,
        "placement": touched.placement,
        "row": touched.row,
        "probability": touched.probability,
        "p_value": touched.p_value,
        "alternatives": [
            {"cause": rival.cause, "location": str(rival.location), "probability": probability,
             "angle_deg": 0.0}
            for rival, probability in touched.rivals
        ],
        "gain": _gain(diagnosis.touched_gain),
        "in_extended_calibration": False,
        "depends_on": list(touched.candidate.depends_on),
        "reading": describe_moved(touched),
        "reason": effect.reason,
        "confounded_with": effect.confounded_with,
    }  # fmt: skip


def _outliers(diagnosis: Diagnosis, gain: Gain) -> dict[str, Any]:
    effect = CATALOGUE["outliers"]
    rows = diagnosis.outliers
    return {
        "cause": "outliers",
        "location": "rows",
        "parameters": [make_row("count", float(len(rows)), "1", 0.0)],
        "rows": [{"session": o.session, "row": o.row, "error_um": o.error_um} for o in rows],
        "probability": 1.0 - diagnosis.outlier_p,
        "p_value": diagnosis.outlier_p,
        "alternatives": [],
        "gain": _gain(gain),
        "depends_on": [],
        "reading": effect.describe(Candidate("outliers", ROWS, (), ()), np.zeros(len(rows))),
        "reason": effect.reason,
        "confounded_with": effect.confounded_with,
    }

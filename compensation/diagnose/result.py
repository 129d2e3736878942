"""A diagnosis as `armd diagnose --json` writes it (docs: the contract's section 4)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt

from armd.compensation.diagnose.advice import next_experiment
from armd.compensation.diagnose.diagnose import Diagnosis
from armd.compensation.diagnose.explains import Explained
from armd.compensation.diagnose.findings import Finding
from armd.compensation.diagnose.fitting.curves import orders_of
from armd.compensation.diagnose.fitting.nuisance import is_curve
from armd.compensation.diagnose.fitting.problem import spare_rows
from armd.compensation.diagnose.fitting.scanned import scanned_uncertainty
from armd.compensation.diagnose.fitting.target_steps import TargetStep, steps, target_steps
from armd.compensation.diagnose.gain import Gain
from armd.compensation.diagnose.search import MOST_FINDINGS
from armd.compensation.diagnose.touched import Touched
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Candidate, clock, plain
from armd.compensation.effects.location import ROWS

F64 = npt.NDArray[np.float64]

#: With more placements and targets than this a list of them is no help.
MOST_TARGETS = 40
#: Residuals so many times the noise's RMS are more than noise.
BEYOND_NOISE = 1.5
#: Noise units from which on a cause is found mostly; fewer numbers to spare tell no noise.
WOULD_SHOW, LEAST_SPARE = 5.0, 30
#: A size is known when it is so many of its standard uncertainties.
SIZE_SIGMAS = 2.0


def as_json(diagnosis: Diagnosis, extended_path: str | None) -> dict[str, Any]:
    """The whole result as plain data."""
    findings = [
        _finding(diagnosis, i, found, gain)
        for i, (found, gain) in enumerate(zip(diagnosis.found, diagnosis.gains, strict=True))
    ]
    findings = [*(_touched(diagnosis, one) for one in diagnosis.touched), *findings]
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
            "heldout_rms_um_extended": diagnosis.written_rms_um[1],
            "heldout_by": "session" if diagnosis.holdout else "placement, in turn",
        },
        "findings": findings,
        "unexplained": {
            "rms_um": float(np.sqrt(unexplained)),
            "significant": diagnosis.significant_rest,
            "depends_on": list(diagnosis.search.remaining_depends_on)
            if diagnosis.significant_rest
            else [],
            "by_target": [asdict(one) for one in _few(target_steps(diagnosis.search.last))],
        },
        "readings": {"told": list(diagnosis.told)},
        "verdict": verdict(diagnosis),
        "cannot_tell": [
            {"cause": cause, "needs": needs_of(cause), "experiment": CATALOGUE[cause].experiment}
            for cause in diagnosis.search.untold
        ],
        "would_show": [
            {"cause": cause, "signal_to_noise_at_typical_size": snr}
            for cause, snr in sorted(diagnosis.search.would_show.items())
        ],
        "extended_calibration": extended_path,
        "next_experiment": next_experiment(diagnosis),
    }


def verdict(diagnosis: Diagnosis) -> str:
    """What came of it, in a sentence or two."""
    sentences = []
    refused, moved = _refused(diagnosis), _moved(diagnosis)
    gains = diagnosis.gains
    doubtful = _numbers(i for i, gain in enumerate(gains) if not gain.shown)
    if not gains:
        sentences.append(
            "No cause was found in the arm." if diagnosis.touched else "No cause was found."
        )
    else:
        count = f"{len(gains)} finding{'' if len(gains) == 1 else 's'}"
        if diagnosis.written:
            before, after = diagnosis.written_clear_um or diagnosis.written_rms_um
            how = ", targets left out within placements" if diagnosis.by_target else ""
            if diagnosis.written_clear_um:
                all_rows = " instead of ".join(um(rms) for rms in diagnosis.written_rms_um[::-1])
                how += f", outliers left out of both; {all_rows} µm with them"
            borne_out = f", {_numbers(diagnosis.written)} in it," if doubtful else ""
            sentences.append(
                f"{count}; with the extended model{borne_out} held-out readings err by "
                f"{um(after)} µm instead of {um(before)} µm (3-D RMS{how})."
            )
        if doubtful:
            sentences.append(f"Held-out readings do not bear out {doubtful}: leads, not facts.")
        guesses = _numbers(
            i
            for i, found in enumerate(diagnosis.found)
            if found.candidate.cause != "unknown" and found.explained and found.explained.guess
        )
        if guesses:
            sentences.append(
                f"The name of {guesses} is a guess: it explains little of what goes with its "
                "variables."
            )
        unsized = _numbers(i for i in range(len(gains)) if not size_known(diagnosis, i))
        if unsized:
            sentences.append(f"The size of {unsized} is within its own uncertainty.")
        if not diagnosis.written:
            sentences.append(
                f"{count}, none of them borne out: the extended calibration predicts what the "
                f"model under test does, {um(diagnosis.heldout_rms_um)} µm held out."
            )
    if diagnosis.significant_rest:
        on = ", ".join(diagnosis.search.remaining_depends_on) or "nothing that was recorded"
        sentences.append(f"Something significant is left; it goes with {on}.")
        same = [
            str(i)
            for i, found in enumerate(diagnosis.found, 1)
            if set(found.candidate.depends_on) & set(diagnosis.search.remaining_depends_on)
        ]
        if same:
            sentences.append(f"The form of {', '.join(same)} is in doubt.")
        if len(gains) == MOST_FINDINGS:
            sentences.append(
                f"No more than {MOST_FINDINGS} causes are looked for; where so much seems wrong, "
                "see first whether arm.toml, calibration and artefact are those of these readings."
            )
    elif not gains and not diagnosis.outliers:
        sentences.append(_nothing_found(diagnosis, refused or moved))
    elif gains and not diagnosis.outliers:
        sentences.append(_what_stays(diagnosis))
    return " ".join(
        text
        for text in [
            *sentences,
            *refused,
            *moved,
            *map(touched_in_words, diagnosis.touched),
            *diagnosis.told,
        ]
        if text
    )


def _numbers(of: Iterable[int]) -> str:
    """Findings as they are counted for a person, from 1."""
    return ", ".join(str(i + 1) for i in of)


def _what_stays(diagnosis: Diagnosis) -> str:
    """Residuals beyond the noise in which nothing is significant, beside findings."""
    left, floor = diagnosis.remaining_rms_um, diagnosis.noise_floor_um
    if left <= BEYOND_NOISE * floor:
        return ""
    return (
        f"Yet {um(left)} µm stay under the extended calibration, where the noise alone would leave "
        f"{um(floor)} µm."
    )


def _nothing_found(diagnosis: Diagnosis, but: Sequence[str]) -> str:
    """What residuals without a finding are, *but* for what the verdict says else."""
    left, floor = diagnosis.rms_um, diagnosis.noise_floor_um
    if left > BEYOND_NOISE * floor:
        return (
            f"Yet the residuals, {um(left)} µm, are not what noise of {um(floor)} µm makes: "
            "nothing in the catalogue, nor any smooth structure, explains them."
        )
    if but:
        return ""
    return f"The residuals are what the noise makes of them. {_could_show(diagnosis)}"


def _could_show(diagnosis: Diagnosis) -> str:
    """What silence is worth: whether causes of ordinary size would have been found."""
    observations = diagnosis.search.last.linear.rests.observations
    spare = spare_rows(observations)
    if spare < LEAST_SPARE:
        return (
            f"But {observations.n} readings at rest leave only {spare} numbers beyond what their "
            "placements take up: hardly any cause could have shown."
        )
    hidden = sorted(c for c, snr in diagnosis.search.would_show.items() if snr < WOULD_SHOW)
    if not hidden:
        return "Any cause of its typical size would have shown."
    return f"Of its typical size, these readings would not have shown: {', '.join(hidden)}."


def _refused(diagnosis: Diagnosis) -> list[str]:
    return [
        f"{_named(one.candidate)} was refused, though the residuals would like it: {one.reason}."
        for one in diagnosis.search.refused
    ]


def _moved(diagnosis: Diagnosis) -> list[str]:
    return [
        f"At {one.placement}, {one.target}, the first {one.after} rests stand {um(one.step_um)} µm "
        f"from the other {one.rests - one.after}: seat, artefact or arm moved between."
        for one in steps(target_steps(diagnosis.search.last))
    ]


def _named(candidate: Candidate) -> str:
    """A candidate in words."""
    if candidate.cause == "unknown":
        return f"A structure in {', '.join(candidate.depends_on)} ({candidate.location})"
    return f"{candidate.cause} ({candidate.location})"


def _few(of: list[TargetStep]) -> list[TargetStep]:
    """None where there are too many to read."""
    return of if len(of) <= MOST_TARGETS else []


def um(value: float) -> str:
    """Micrometres as a person writes them: three digits, no exponent."""
    return plain(value, 3)


def needs_of(cause: str) -> str:
    """What sessions must hold for a cause to show at all."""
    return (
        CATALOGUE[cause].needs or "poses or conditions that set it apart from placements and seats"
    )


def _finding(diagnosis: Diagnosis, index: int, found: Finding, gain: Gain) -> dict[str, Any]:
    candidate = found.candidate
    effect = CATALOGUE[candidate.cause]
    return {
        "cause": candidate.cause,
        "location": place_of(candidate),
        "parameters": parameters_of(diagnosis, index),
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
        "size_known": size_known(diagnosis, index),
        "in_extended_calibration": index in diagnosis.written,
        "depends_on": list(candidate.depends_on),
        "signal_to_noise": float(np.sqrt(found.statistic)),
        "tip_rms_um": tip_rms_um(diagnosis, index),
        "explains": _explains(found.explained),
        "reading": reading_of(diagnosis, index),
        "reason": effect.reason,
        "confounded_with": effect.confounded_with,
    }


def _explains(explained: Explained | None) -> dict[str, Any] | None:
    """How much a cause accounts for, and whether its amplitude is the same everywhere."""
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


def place_of(candidate: Candidate) -> str:
    """The location as the contract has it: nothing is claimed of what is unknown."""
    return "-" if candidate.cause == "unknown" else str(candidate.location)


def reading_of(diagnosis: Diagnosis, index: int) -> str:
    """What the amplitudes mean, in words."""
    candidate = diagnosis.search.last.findings[index]
    of_curve = CATALOGUE[candidate.cause].curve_reading
    if of_curve is not None and is_curve(candidate):
        rms, _, order = curve_size(diagnosis, index)
        return of_curve(candidate, rms, order)
    effect = CATALOGUE[diagnosis.found[index].candidate.cause]
    text = effect.reading(candidate, diagnosis.search.last.amplitudes[index])
    if effect.by_weight and any(joint.mass_kg is None for joint in diagnosis.arm.joint):
        text += " (masses that arm.toml does not give are assumed)"
    explained = diagnosis.found[index].explained
    if explained is not None and explained.guess and effect.cause != "unknown":
        on = " and ".join(explained.variables) or "the readings"
        share = f"{100 * explained.share:.0f} %"
        text += f"; it explains {share} of what depends on {on}: the name is a guess"
    if not size_known(diagnosis, index):
        text += "; this size is within its own uncertainty, and not to be relied on"
    return text


def size_known(diagnosis: Diagnosis, index: int) -> bool:
    """Whether a finding's amplitudes are larger than what is uncertain of them.

    Something is significant; where several amplitudes do the same, none of them need be known.
    """
    last = diagnosis.search.last
    typical = np.array([column.typical for column in last.findings[index].columns])
    size = last.amplitudes[index] / typical
    covariance = last.covariances[index] / np.outer(typical, typical)
    square = float(size @ size)
    return square**2 > SIZE_SIGMAS**2 * float(size @ covariance @ size)


def parameters_of(diagnosis: Diagnosis, index: int) -> list[dict[str, str | float]]:
    """Amplitudes with standard uncertainties, then what was scanned (order, instant, …)."""
    last = diagnosis.search.last
    candidate = last.findings[index]
    rows: list[dict[str, str | float]] = []
    if is_curve(candidate):
        rms, sigma, order = curve_size(diagnosis, index)
        rows += [_row("rms", rms, "rad", sigma), _row("order", float(order), "1/turn", 0.0)]
    else:
        spread = np.sqrt(np.maximum(np.diag(last.covariances[index]), 0.0))
        rows += [
            _row(column.name, float(value), column.unit, float(s))
            for column, value, s in zip(
                candidate.columns, last.amplitudes[index], spread, strict=True
            )
        ]
    sigma = scanned_uncertainty(last, index, diagnosis.arm)
    rows += [_row(name, value, unit, sigma) for name, value, unit in candidate.setting]
    return rows


def curve_size(diagnosis: Diagnosis, index: int) -> tuple[float, float, int]:
    """Root mean square in rad of a curve about its mean, its standard uncertainty, and the
    curve's strongest order.

    All over the angles at which the joint stood: elsewhere nothing is known, and over less than
    a turn the amplitudes of single orders mean little.
    """
    last = diagnosis.search.last
    candidate = last.findings[index]
    joint = candidate.location.joint
    assert joint is not None  # a curve is over the turn of one
    q = last.linear.rests.observations.states.q[:, joint - 1]
    seen = np.unique(np.round(np.degrees(q))) * np.pi / 180.0
    orders = orders_of(candidate)
    waves = np.array([wave(order * seen) for order in orders for wave in (np.sin, np.cos)])
    level = waves - waves.mean(axis=1, keepdims=True)
    curve = last.amplitudes[index] @ level
    rms = max(float(np.sqrt((curve**2).mean())), 1e-300)
    slope = level @ curve / (len(seen) * rms)
    sigma = float(np.sqrt(max(slope @ last.covariances[index] @ slope, 0.0)))
    left = []
    for pair in waves.reshape(len(orders), 2, -1):
        columns = np.vstack([pair, np.ones(len(seen))]).T
        fitted = columns @ np.linalg.lstsq(columns, curve, rcond=None)[0]
        left.append(float(((curve - fitted) ** 2).sum()))
    return rms, sigma, orders[int(np.argmin(left))]


def _row(name: str, value: float, unit: str, sigma: float) -> dict[str, str | float]:
    return {"name": name, "value": value, "unit": unit, "standard_uncertainty": sigma}


def tip_rms_um(diagnosis: Diagnosis, index: int) -> float:
    """How far the effect moves the tip in these readings, 3-D RMS in µm: what placements,
    constants and the other findings cannot take up."""
    moves = diagnosis.search.last.net_signature(index)
    return 1e3 * float(np.sqrt((moves**2).sum() / max(len(moves), 1)))


def _gain(gain: Gain) -> dict[str, Any]:
    clear = gain.without_outliers_um
    return {
        **({"heldout_rms_um_without_outliers": list(clear)} if clear else {}),
        "heldout_rms_um_before": gain.before_um,
        "heldout_rms_um_after": gain.after_um,
        "interval_um": list(gain.interval_um),
        "shown": gain.shown,
    }


def touched_in_words(touched: Touched) -> str:
    """What was moved, where and when."""
    what = CATALOGUE["artefact_moved"].reading(touched.candidate, touched.amplitudes)
    when = "" if np.isnan(touched.instant_unix_s) else f", {clock(touched.instant_unix_s)}"
    return (
        f"In {touched.session}, {touched.placement}, before row {touched.row}{when}, {what}: its "
        "readings count as two placements; nothing of that is the arm's."
    )


def _touched(diagnosis: Diagnosis, touched: Touched) -> dict[str, Any]:
    effect = CATALOGUE["artefact_moved"]
    assert diagnosis.touched_gain is not None
    rows = [
        _row(column.name, float(value), column.unit, float(sigma))
        for column, value, sigma in zip(
            touched.candidate.columns, touched.amplitudes, touched.uncertainties, strict=True
        )
    ]
    return {
        "cause": "artefact_moved",
        "location": "artefact",
        "parameters": [*rows, _row("instant", touched.instant_unix_s, "s (Unix)", 0.0)],
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
        "reading": touched_in_words(touched),
        "reason": effect.reason,
        "confounded_with": effect.confounded_with,
    }  # fmt: skip


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
        "reading": effect.reading(Candidate("outliers", ROWS, (), ()), np.zeros(len(rows))),
        "reason": effect.reason,
        "confounded_with": effect.confounded_with,
    }

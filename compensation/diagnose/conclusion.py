"""The conclusion of a diagnosis: its findings, as judged by held-out readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.diagnosis import (
    Diagnosis,
    Finding,
    Gain,
    Outlier,
    SearchResult,
    ValidatedFindings,
)
from armd.compensation.diagnose.extend import extend_calibration
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.fitting.follow import follow_solution
from armd.compensation.diagnose.fitting.free_expansion import report_growth
from armd.compensation.diagnose.fitting.under_test import has_reflectors
from armd.compensation.diagnose.heldout.gain import compute_gain, compute_gains, group_readings
from armd.compensation.diagnose.heldout.later_gain import predict_later_gain
from armd.compensation.diagnose.heldout.open_constants import add_open_constants
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Rests
from armd.compensation.diagnose.search.work import WorkBudget
from armd.compensation.diagnose.search_outcome import SearchOutcome
from armd.compensation.estimate.observations import TURN_MM, Observations, collect_observations
from armd.compensation.identify.admission.mistakes import AssumedModel
from armd.compensation.identify.admission.wrong_names import report_misnamed
from armd.compensation.identify.evaluation.evaluate import Evaluation, evaluate
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration


@dataclass(frozen=True)
class HeldoutJudgement:
    """The judgement of a search's findings by held-out readings, and the outliers."""

    squares: Sequence[F64]  # (n,) mm² of each held-out reading, without findings and after each
    groups: I64
    readings: Observations  # the held-out readings
    gains: Sequence[Gain]
    written: ValidatedFindings
    outlying: I64  # numbers of rests
    outlier_p: float


def describe_readings(searched: SearchOutcome, arm: Arm) -> list[str]:
    """Return remarks about a search's readings and the model under which they were searched."""
    result, baseline, remarks = searched.result, searched.baseline, list[str]()
    if len(result.last.findings) == len(result.searched.findings):
        remarks += report_growth(baseline)
    if has_reflectors(searched.prepared.sessions):  # reflectors have no common tip
        return remarks
    remarks += report_misnamed(
        searched.prepared.sessions,
        collect_observations(searched.prepared.sessions, arm, baseline.calibration.artefact),
        AssumedModel.from_calibration(arm, baseline.calibration),
    )
    return remarks


def make_diagnosis(
    searched: SearchOutcome,
    heldout: HeldoutJudgement,
    arm: Arm,
    holdout: Sequence[Session],
    remarks: Sequence[str],
    work: WorkBudget,
    command: str,
) -> Diagnosis:
    """Make the diagnosis of a search and of its judgement by held-out readings.

    *remarks*: those about the readings.
    """
    remarks = list(remarks)
    prepared, baseline = searched.prepared, searched.baseline
    sessions, rests, touched = prepared.sessions, prepared.rests, prepared.touched
    result, last = searched.result, searched.result.last
    squares, groups, written = heldout.squares, heldout.groups, heldout.written
    remarks += describe_off_orientations(heldout.outlying, rests, last)
    outlying = np.unique(rests.point_of[heldout.outlying])
    outliers = name_outliers(outlying, rests, last)
    is_used = np.ones(len(groups), dtype=bool)
    if not holdout:  # outliers are rows of the search: held-out sessions keep all rows
        is_used[outlying] = False
    measured = [
        replace(
            written.gains.get(i, g),
            is_confirmed=i in written.numbers
            or (finding.candidate.is_report_only and g.is_confirmed),
        )
        for i, (finding, g) in enumerate(zip(result.findings, heldout.gains, strict=True))
    ]
    if not is_used.all():
        without_outliers = compute_gains(
            [heldout_squares[is_used] for heldout_squares in squares],
            groups[is_used],
            is_used[is_used],
        )
        pairs = [(step.before_um, step.after_um) for step in without_outliers]
        measured = [
            g if i in written.gains else replace(g, without_outliers_um=pair)
            for i, (g, pair) in enumerate(zip(measured, pairs, strict=True))
        ]
    result = replace(result, findings=reduce_odds(result.findings, written.doubts))
    remarks += work.in_words()
    if not last.noise.settled:
        remarks.append("The estimate of the noise did not settle: all probabilities are in doubt.")
    extension = _write_extension(written, result, rests, arm, sessions, command)
    repeated = holdout or not written.growth  # the repeated search has no expansion of link 1
    if len(written.numbers) == len(result.findings) and not written.gains and repeated:
        written = replace(written, after=squares[-1])  # with all findings written: the last step's
    return Diagnosis(
        arm=arm,
        sessions=tuple(sessions),
        holdout=tuple(holdout),
        baseline=baseline,
        search=result,
        rms_um=_compute_rms_um(evaluate(sessions, arm, baseline.calibration)),
        heldout_rms_um=1e3 * float(np.sqrt(squares[0].mean())),
        noise_floor_um=last.noise_floor_um,
        remaining_rms_um=_compute_rms_um(evaluate(sessions, arm, extension)),
        gains=tuple(measured),
        outliers=outliers,
        outlier_p=heldout.outlier_p,
        outlier_gain=compute_gain(squares[-1], squares[-1], groups, is_used) if outliers else None,
        written=written.numbers,
        written_rms_um=_compute_rms_um_pair(written, np.ones_like(is_used)),
        written_clear_um=None if is_used.all() else _compute_rms_um_pair(written, is_used),
        later_gain_um=predict_later_gain(written.before, written.after, heldout.readings)
        if written.numbers
        else None,
        contradicted_later=written.contradicted_later,
        written_by=written.by,
        extended=extension,
        remarks=tuple(remarks),
        touched=touched,
        touched_gain=_compute_parting_gain(
            prepared.original_sessions, sessions, arm, baseline.calibration
        )
        if touched
        else None,
        skipped=tuple(work.skipped),
    )


def _compute_parting_gain(
    original: Sequence[Session], parted: Sequence[Session], arm: Arm, calibration: Calibration
) -> Gain:
    """Return the gain of two poses over one, for moved artefacts' placements under one model."""
    as_one, as_two = (evaluate(group, arm, calibration) for group in (original, parted))
    squares = [(evaluation.residual_mm**2).sum(axis=1) for evaluation in (as_one, as_two)]
    return compute_gain(squares[0], squares[1], group_readings(as_one.observations))


def _compute_rms_um_pair(written: ValidatedFindings, is_used: Mask) -> tuple[float, float]:
    before, after = (
        1e3 * float(np.sqrt(s[is_used].mean())) for s in (written.before, written.after)
    )
    return before, after


def _write_extension(
    written: ValidatedFindings,
    result: SearchResult,
    rests: Rests,
    arm: Arm,
    sessions: Sequence[Session],
    command: str,
) -> Calibration:
    """Make the calibration with the findings that are written.

    Without any it predicts what the calibration under test does.
    """
    last, numbers = result.last, written.numbers
    lost = any(session.lost_links for session in rests.sessions)
    if last.findings and lost and not last.baseline.is_given:
        # In the search the lengths of a link without a sensor are free in each session, so that its
        # expansion is undetermined. The written calibration keeps the expansion of the one under
        # test, by the mean of the other sensors, as far as that holds.
        tied = tuple(replace(session, lost_links=()) for session in rests.sessions)
        rests, start = replace(rests, sessions=tied), last.baseline.model
        last = fit(
            rests, arm, last.baseline, start, last.findings, last.amplitudes, noise=last.noise
        )
    model = last
    if len(numbers) < len(last.findings):
        model = fit(
            rests,
            arm,
            last.baseline,
            last.model,
            [last.findings[i] for i in numbers],
            [last.amplitudes[i] for i in numbers],
            noise=last.noise,
        )
    left_out = [c for i, c in enumerate(last.findings) if i not in numbers]
    model = follow_solution(model, arm)
    calibration = extend_calibration(model, arm, sessions, command, left_out, written.growth)
    return add_open_constants(calibration, last, numbers, arm, sessions)


def reduce_odds(findings: Sequence[Finding], doubts: Mapping[int, float]) -> tuple[Finding, ...]:
    """Multiply the odds of findings by factors (*doubts*, by number) from held-out readings."""
    lowered = []
    for i, finding in enumerate(findings):
        odds, p = doubts.get(i, 1.0), finding.probability
        lowered.append(replace(finding, probability=p * odds / (p * odds + 1.0 - p)))
    return tuple(lowered)


def _compute_rms_um(evaluation: Evaluation) -> float:
    return float(np.sqrt((evaluation.distance_um**2).mean()))


def describe_off_orientations(rests: I64, all_rests: Rests, last: Fit) -> list[str]:
    """Describe of which of these *rests* the orientation is off, and by how much."""
    observations = all_rests.observations
    turned = rests[observations.turned[rests]]
    off_deg = np.degrees(np.linalg.norm(last.rest_residual_mm[turned], axis=1) / TURN_MM)
    return [
        f"The orientation of {observations.name_row(rest)} is off by {off:.3g}°."
        for rest, off in zip(turned.tolist(), off_deg, strict=True)
    ]


def name_outliers(rests: I64, all_rests: Rests, last: Fit) -> tuple[Outlier, ...]:
    """List every reading of these *rests*, by its session and its row."""
    lengths = [s.n for s in all_rests.sessions]
    first = np.concatenate([[0], np.cumsum(lengths)])
    named = []
    for rest in rests:
        error = 1e3 * float(np.linalg.norm(last.rest_residual_mm[rest]))
        for reading in np.flatnonzero(all_rests.rest_of == rest):
            session = int(np.searchsorted(first, reading, side="right")) - 1
            row = int(all_rests.sessions[session].row[reading - first[session]]) + 1
            named.append(Outlier(all_rests.sessions[session].name, row, error))
    return tuple(named)

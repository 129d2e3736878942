"""An artefact that was moved while it was measured: detected and corrected before the search.

A placement is one rigid pose only if nobody touches the artefact. The placement is split at each
step that stands out of the scatter of its readings. All steps are looked for in one first fit. Each
must explain the readings better than a slip or a step of the base at that instant. No reading is
lost, and no residual remains that the search would attribute to the arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import softmax

from armd.arrays import F64, I64
from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.constants import (
    ABSORBED,
    LEAST_P,
    LEAST_PROBABILITY,
    LEAST_RESTS_BESIDE,
    LEAST_TARGETS,
    MOST_MOVED,
    RANK_SHARE,
    REWEIGHTINGS,
    TOUCHED_FINER,
    TOUCHED_GRID,
)
from armd.compensation.diagnose.diagnosis import MovedArtefact
from armd.compensation.diagnose.fitting.refit import solve_with_findings
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Rests
from armd.compensation.diagnose.problem.signatures import identify_kind, make_finding_columns
from armd.compensation.diagnose.scoring.candidates import score_candidates
from armd.compensation.diagnose.scoring.evidence import estimate_amplitudes
from armd.compensation.diagnose.scoring.projection import Projection, make_projection
from armd.compensation.diagnose.scoring.robust_refit import clip_about
from armd.compensation.diagnose.scoring.scatter import compute_log_p_by_scatter
from armd.compensation.diagnose.scoring.threshold import compute_family_wise_p, is_significant
from armd.compensation.diagnose.search.findings import find_nearest_step
from armd.compensation.diagnose.search.survey import Survey
from armd.compensation.effects.effect import ArtefactChange, Candidate
from armd.compensation.effects.setup.artefact_moved import make_candidate
from armd.compensation.effects.setup.mount_drift import MOST_MOUNT_STEP
from armd.compensation.estimate.noise.robust import compute_huber_loss, compute_huber_weights


def find_moved_artefacts(first: Fit, survey: Survey) -> tuple[list[MovedArtefact], Fit]:
    """Return the steps of single placements, the clearest first, and the fit with all of them.

    They are added to the *first* fit of a search one by one: each is weighed beside those before.
    """
    rests = first.linear.rests
    placements = rests.in_order.items()
    coarse = [make_candidate(p, k) for p, rows in placements for k in _grid(_possible(rests, rows))]
    moves: list[MovedArtefact] = []
    fit = first
    while coarse and len(moves) < MOST_MOVED:
        move = _find_clearest(make_projection(fit, survey.arm), coarse, survey.refusals.candidates)
        if move is None:
            break
        moves.append(move)
        fit = survey.fit([move.candidate for move in moves], fit)
    return moves, fit


def _find_clearest(
    projection: Projection, coarse: Sequence[Candidate], catalogue: Sequence[Candidate]
) -> MovedArtefact | None:
    """Return the clearest step of one placement, or None if another step explains more.

    *coarse*: steps of the artefact at few instants of each placement. *catalogue*: all candidates.
    """
    rests = projection.fit.linear.rests
    coarse_scores = score_candidates(projection, coarse).scores
    best = int(np.argmax(coarse_scores.log_evidence))
    tests = len(catalogue) + len(coarse)
    if not is_significant(coarse_scores.log_p[best], tests):
        return None
    candidate = _refined(coarse[best], projection)
    about = _clipped_about(candidate, projection)
    # A session that scatters more than the others (a floor that shakes) has larger steps by chance.
    if not is_significant(compute_log_p_by_scatter(candidate, about), tests):
        return None
    rivals = _at_the_instant(candidate, catalogue, rests)
    compared = score_candidates(about, [candidate, *rivals])
    evidence = compared.scores.log_evidence
    if len(rivals) and evidence[0] < evidence[1:].max():
        return None
    share = softmax(evidence)
    reported = sorted(zip(rivals, share[1:], strict=True), key=lambda pair: -pair[1])
    amplitudes = estimate_amplitudes(compared.sums)[0]
    columns = make_finding_columns(projection.fit.linear, [candidate], projection.arm)[0]
    white, cleared = about.clear_of_all(columns)
    variance = np.diag(np.linalg.pinv(white.T @ cleared, rcond=ABSORBED, hermitian=True))
    session, placement, row, instant = _locate(candidate, rests)
    return MovedArtefact(
        session=session,
        placement=placement,
        row=row,
        instant_unix_s=instant,
        candidate=candidate,
        amplitudes=amplitudes,
        uncertainties=np.sqrt(np.maximum(variance, 0.0)),
        p_value=max(float(compute_family_wise_p(compared.scores.log_p[0], tests)), LEAST_P),
        probability=float(share[0]),
        rivals=tuple((rival, float(p)) for rival, p in reported if p >= LEAST_PROBABILITY),
    )


def _clipped_about(candidate: Candidate, projection: Projection) -> Projection:
    """Clip the projection's residual about the fit with the candidate in the model."""
    return make_projection(clip_about(candidate, projection).fit, projection.arm)


def _possible(rests: Rests, in_time: I64) -> I64:
    """Return after how many of the rests *in_time* (in order) a step can be separated from the
    arm's.

    Without times the result is empty: a slip at that instant is then no candidate to compare with.
    """
    if not np.isfinite(rests.observations.states.time_s[in_time]).all():
        return np.zeros(0, dtype=np.int64)
    points = np.flatnonzero(~rests.observations.turned[in_time])  # orientations follow their points
    in_time = in_time[points]
    target = rests.observations.target[in_time]
    begins = np.zeros(len(in_time), dtype=np.int64)
    begins[np.unique(target, return_index=True)[1]] = 1
    last = np.zeros(len(in_time), dtype=np.int64)
    last[len(in_time) - 1 - np.unique(target[::-1], return_index=True)[1]] = 1
    after = np.arange(LEAST_RESTS_BESIDE, len(in_time) - LEAST_RESTS_BESIDE + 1)
    before = np.cumsum(begins)[after - 1]  # targets among the rests so far
    still = np.cumsum(last[::-1])[::-1][after]  # targets among the rests to come
    possible: I64 = points[after[(before >= LEAST_TARGETS) & (still >= LEAST_TARGETS)]]
    return possible


def _grid(possible: I64) -> list[int]:
    """Return some of the numbers *possible*, evenly spread."""
    picked = np.linspace(0, len(possible) - 1, min(TOUCHED_GRID, len(possible))).round().astype(int)
    return [int(k) for k in possible[np.unique(picked)]]


def _refined(candidate: Candidate, projection: Projection) -> Candidate:
    """Return the step of that placement at the instant with the least Huber loss.

    The pose is fitted separately to the readings before and after, as measured. With the residual
    clipped about another instant, the true step would look like an outlier.
    """
    number = _change(candidate).index
    in_time, pose, residual = _as_measured(candidate, projection)

    def loss(k: int) -> float:
        cut = 3 * k
        parts = ((pose[:cut], residual[:cut]), (pose[cut:], residual[cut:]))
        return sum(compute_huber_loss(_distance(*part)) for part in parts)

    possible = _possible(projection.fit.linear.rests, in_time)
    while True:  # a placement of thousands of rests is searched in finer and finer steps
        step = max(len(possible) // TOUCHED_FINER, 1)
        best = min(possible[::step].tolist(), key=loss)
        if step == 1:
            return make_candidate(number, best)
        possible = possible[np.abs(possible - best) <= 2 * step]


def _as_measured(candidate: Candidate, projection: Projection) -> tuple[I64, F64, F64]:
    """Return the moved placement's rests, its pose columns and its residual without findings.

    The rests are in order (k,); the pose columns (3 k, 6) and the residual (3 k,) are whitened. The
    findings are fitted together with the step: otherwise a cause that may differ from session to
    session would have absorbed a part of it.
    """
    number = _change(candidate).index
    fit = projection.fit
    if fit.findings:
        about = _clipped_about(candidate, projection).fit
        fit = solve_with_findings(about, (*fit.findings, candidate), projection.arm)
    in_time = fit.linear.rests.in_order[number]
    rows = (3 * in_time[:, None] + np.arange(3)).ravel()
    whitener = fit.noise.whitener[in_time]
    pose = make_finding_columns(fit.linear, [make_candidate(number, 0)], projection.arm)[0][rows]
    pose = (whitener @ pose.reshape(-1, 3, 6)).reshape(-1, 6)
    # Only the findings are subtracted: in the fit a drifting base has absorbed a part of the step.
    columns_of_findings = [
        j for span in fit.layout.findings[:-1] for j in range(span.start, span.stop)
    ]
    columns = fit.nuisance.columns.to_dense(np.array(columns_of_findings, dtype=int))
    explained = columns[rows] @ fit.solution[columns_of_findings]
    raw = fit.raw_residual[rows] - explained
    return in_time, pose, (whitener @ raw.reshape(-1, 3, 1)).ravel()


def _distance(columns: F64, residual: F64) -> F64:
    """Return distances (k,) of whitened rests (3 k,) from their own robust pose (Huber)."""
    weight = np.ones(len(residual))
    size = np.zeros(0)
    for _ in range(REWEIGHTINGS):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(columns * root[:, None], residual * root, rcond=RANK_SHARE)[0]
        size = np.linalg.norm((residual - columns @ solution).reshape(-1, 3), axis=1)
        weight = np.repeat(compute_huber_weights(size), 3)
    return size


def _change(candidate: Candidate) -> ArtefactChange:
    change = candidate.columns[0].artefact
    assert change is not None
    return change


def _steps(candidate: Candidate) -> bool:
    return candidate.instant_unix_s is not None


def _at_the_instant(
    candidate: Candidate, catalogue: Sequence[Candidate], rests: Rests
) -> list[Candidate]:
    """Return the step nearest to that instant of each place that may have stepped then."""
    instant = _compute_instant(_change(candidate), rests)
    grid: dict[tuple[str, ...], list[Candidate]] = {}
    for step in filter(_steps, catalogue):
        grid.setdefault(identify_kind(step), []).append(step)
    return [_as_large_as_it_steps(find_nearest_step(instant, of_kind)) for of_kind in grid.values()]


def _as_large_as_it_steps(step: Candidate) -> Candidate:
    columns = tuple(replace(column, reach=MOST_MOUNT_STEP) for column in step.columns)
    return replace(step, columns=columns) if step.cause == "mount_drift" else step


def _compute_instant(change: ArtefactChange, rests: Rests) -> float:
    """Return the time halfway between the rests before and after a step, in s (Unix)."""
    time_s = rests.observations.states.time_s[rests.in_order[change.index]]
    return float(time_s[change.after - 1 : change.after + 1].mean())


def _find_rows_after(change: ArtefactChange, rests: Rests) -> tuple[int, I64]:
    """Return the number of a step's session, and its rows after the step in that placement."""
    order = rests.in_order[change.index]
    later = np.zeros(rests.n + 1, dtype=bool)  # the last entry: readings that are in no rest
    later[order[change.after :]] = True
    number = int(rests.observations.session[order[0]])
    begin = sum(session.n for session in rests.sessions[:number])
    return number, np.flatnonzero(later[rests.rest_of[begin : begin + rests.sessions[number].n]])


def _locate(candidate: Candidate, rests: Rests) -> tuple[str, str, int, float]:
    """Return a step's session and placement, the first row after it (from 1) and its instant."""
    change = _change(candidate)
    number, rows = _find_rows_after(change, rests)
    session, name = rests.sessions[number], rests.observations.session_names[number]
    placement = rests.observations.placement_names[change.index].removeprefix(f"{name}/")
    first = int(rows[np.argmin(session.states.time_s[rows])])
    return name, placement, int(session.row[first]) + 1, _compute_instant(change, rests)


def split_placements(rests: Rests, moves: Sequence[MovedArtefact]) -> tuple[Session, ...]:
    """Return the sessions with each placement split where its artefact moved."""
    sessions = list(rests.sessions)
    changes = [_change(move.candidate) for move in moves]
    for change in sorted(changes, key=lambda change: (change.index, change.after)):
        number, rows = _find_rows_after(change, rests)
        session = sessions[number]
        placement, names = session.placement.copy(), session.placement_names
        placement[rows] = len(names)
        moved = f"{names[session.placement[rows[0]]]} (moved)"
        sessions[number] = replace(session, placement=placement, placement_names=[*names, moved])
    return tuple(sessions)

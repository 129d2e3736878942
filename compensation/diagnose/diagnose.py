"""The whole of `armd diagnose`: causes of a model's error, and the gain of correcting them.

A session of another arm spreads its error over all causes, and the search would name as many as it
may. So sessions that do not fit the others are looked for first, and the others are searched
without them. A session that a few causes explain is included again. Placements are split where
their artefact moved, all at once, before each search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from armd.arrays import I64
from armd.compensation.data.sessions.session import Session
from armd.compensation.data.soundness.soundness import make_sound
from armd.compensation.diagnose.conclusion import (
    HeldoutJudgement,
    describe_readings,
    make_diagnosis,
)
from armd.compensation.diagnose.constants import (
    GAIN_BEGINS,
    HELD_OUT_BEGINS,
    MOST_EXPLAINING,
    MOST_REPEATED,
)
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.fitting.absorbed_error import allow_absorbed_error
from armd.compensation.diagnose.fitting.under_test import make_model_and_judge_sessions
from armd.compensation.diagnose.heldout.cross_validation import validate_in_turn
from armd.compensation.diagnose.heldout.fold_residuals import compare_heldout
from armd.compensation.diagnose.heldout.gain import compute_gains, group_readings
from armd.compensation.diagnose.heldout.refutation import (
    describe_refuted,
    is_better,
    is_refuted,
    select_refuted,
)
from armd.compensation.diagnose.heldout.validation import (
    compute_squares_on_sessions,
    validate_by_placement,
    validate_by_session,
)
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.rests import collect_rests, require_spare
from armd.compensation.diagnose.search.compare_searches import (
    has_clearly_lower_noise,
    is_likely_beside,
    may_replace,
)
from armd.compensation.diagnose.search.moved_artefact import find_moved_artefacts, split_placements
from armd.compensation.diagnose.search.search import Search
from armd.compensation.diagnose.search.work import WorkBudget
from armd.compensation.diagnose.search_outcome import (
    PreparedSessions,
    SearchOutcome,
    drop_inconsistent,
    is_farther_off,
)
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.noise.regions import find_regions
from armd.compensation.estimate.noise.robust import DOWNWEIGHT_CHI2, find_far_off, select_outliers
from armd.compensation.freed import drop_freed
from armd.compensation.identify.admission.inconsistent_session import InconsistentSession
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.progress import TellShare


def diagnose(
    sessions: Sequence[Session],
    arm: Arm,
    calibration: Calibration | None = None,
    holdout: Sequence[Session] = (),
    progress: TellShare = lambda _text, _share: None,
    command: str = "",
) -> Diagnosis:
    """Diagnose *sessions* under a calibration, or under the one that `armd calibrate` makes of
    them.

    Raises `BadInput` where the sessions cannot be calibrated.
    """
    # The matrices are small: the library's own threads cost more than they save, and far more on a
    # busy machine. Without them, a result does not depend on the number of cores either.
    with threadpool_limits(limits=1, user_api="blas"):
        return _diagnose(sessions, arm, calibration, holdout, progress, command)


def _diagnose(
    sessions: Sequence[Session],
    arm: Arm,
    calibration: Calibration | None,
    holdout: Sequence[Session],
    progress: TellShare,
    command: str,
) -> Diagnosis:
    progress("model under test", 0.0)
    sound = make_sound(sessions, arm)
    sessions, arm, remarks = sound.sessions, sound.arm, list(sound.remarks)
    if holdout:
        sound_holdout = make_sound(holdout, arm)
        holdout, remarks = sound_holdout.sessions, remarks + list(sound_holdout.remarks)
    for group in filter(None, (sessions, holdout)):
        require_spare(collect_rests(group, arm).observations, ", ".join(str(s.path) for s in group))
    work = WorkBudget.of_readings(sum(session.n for session in sessions))
    searched, of_sessions = _search_sessions(sessions, arm, calibration, progress, work)
    remarks += of_sessions
    diagnosis = _conclude_search(searched, arm, holdout, remarks, progress, work, command)
    refuted: tuple[Candidate, ...] = ()
    for _ in range(MOST_REPEATED):
        newly_refuted = select_refuted(diagnosis)
        if not newly_refuted:
            break
        if not work.may_go_on:
            work.skip("the search without what held-out readings refute")
            remarks = [*diagnosis.remarks, *work.in_words()]
            return replace(diagnosis, remarks=tuple(remarks), skipped=tuple(work.skipped))
        refuted += newly_refuted
        prepared = searched.prepared
        search = _make_search(prepared, arm, progress, work, refuted)
        without = _search(prepared, search, arm, progress, work, refuted)
        if not is_likely_beside(without.result, diagnosis.search, arm):
            break
        extended_remarks = [*remarks, describe_refuted(refuted)]
        another = _conclude_search(without, arm, holdout, extended_remarks, progress, work, command)
        if not is_better(another, diagnosis):
            break
        diagnosis = another
    return diagnosis


def _conclude_search(
    searched: SearchOutcome,
    arm: Arm,
    holdout: Sequence[Session],
    remarks: Sequence[str],
    progress: TellShare,
    work: WorkBudget,
    command: str,
) -> Diagnosis:
    """Judge the findings of a search by held-out readings; *remarks*: those about the readings."""
    remarks = [*remarks, *describe_readings(searched, arm)]
    drop_freed()
    progress("gain", GAIN_BEGINS)
    result, sessions = searched.result, searched.prepared.sessions
    calibration = searched.baseline.calibration
    outlying, outlier_p = find_outliers(result.last)
    if holdout:
        progress("held out", HELD_OUT_BEGINS)
        readings = evaluate(holdout, arm, calibration).observations
        groups = group_readings(readings)
        written = validate_by_session(result, arm, sessions, holdout, readings)
        squares = [
            compute_squares_on_sessions(step, arm, sessions, holdout, written.growth)
            for step in result.steps()
        ]
        measured = compute_gains(squares, groups, np.ones(len(groups), dtype=bool))
    else:
        readings = result.last.linear.rests.points
        checked = validate_in_turn(result, searched.parted, arm, progress, work)
        searched.parted = None
        squares, groups = checked.squares, checked.groups
        measured = compute_gains(squares, groups, np.ones(len(groups), dtype=bool))
        drop_freed()
        progress("held out", HELD_OUT_BEGINS)
        written = validate_by_placement(result, arm, measured)
    heldout = HeldoutJudgement(squares, groups, readings, measured, written, outlying, outlier_p)
    return make_diagnosis(searched, heldout, arm, holdout, remarks, work, command)


def _search_sessions(
    sessions: Sequence[Session],
    arm: Arm,
    calibration: Calibration | None,
    progress: TellShare,
    work: WorkBudget,
) -> tuple[SearchOutcome, list[str]]:
    """Search the sessions that fit each other; return remarks about the others, too."""
    remarks, strange = list[str](), list[InconsistentSession]()
    of_all, search_of_all = _prepare(sessions, arm, calibration, progress, work)
    prepared, search = of_all, search_of_all
    while prepared.inconsistent is not None:
        strange.append(prepared.inconsistent)
        consistent = drop_inconsistent(prepared.original_sessions, prepared.inconsistent)
        prepared, search = _prepare(consistent, arm, calibration, progress, work)
    searched = _search(prepared, search, arm, progress, work)
    inexplicable = []
    for inconsistent in strange:
        remarks.append(inconsistent.in_words())
        rejoined = of_all, search_of_all
        if len(strange) > 1:
            without_others = drop_inconsistent(
                sessions, *(session for session in strange if session is not inconsistent)
            )
            rejoined = _prepare(without_others, arm, calibration, progress, work)
        progress(f"session {inconsistent.path.name}", 0.0)
        if not _is_explained(*rejoined, inconsistent, searched):
            inexplicable.append(inconsistent)
            remarks.append(
                f"no cause explains session {inconsistent.path.name}: the diagnosis is without it"
            )
    if len(inexplicable) < len(strange):
        if inexplicable:
            explained = drop_inconsistent(sessions, *inexplicable)
            of_all, _ = _prepare(explained, arm, calibration, progress, work)
        of_all = _split(of_all, arm, calibration)
        search = _make_search(of_all, arm, progress, work)
        searched = _search(of_all, search, arm, progress, work)
    return searched, remarks


def _prepare(
    sessions: Sequence[Session],
    arm: Arm,
    calibration: Calibration | None,
    progress: TellShare,
    work: WorkBudget,
) -> tuple[PreparedSessions, Search]:
    """Split placements where the artefact moved, all found in one fit, and judge the sessions.

    A search of them is returned that has not run.
    """
    baseline, inconsistent = make_model_and_judge_sessions(sessions, arm, calibration)
    unsplit = PreparedSessions(
        tuple(sessions), tuple(sessions), collect_rests(sessions, arm), baseline, inconsistent
    )
    search = _make_search(unsplit, arm, progress, work)
    touched, fitted = find_moved_artefacts(search.first_fit, search.survey)
    unsplit = replace(unsplit, touched=tuple(touched), fitted=fitted)
    if not touched or (inconsistent is not None and is_farther_off(fitted, inconsistent.path)):
        return unsplit, search
    parted = _split(unsplit, arm, calibration)
    return parted, _make_search(parted, arm, progress, work)


def _split(
    unsplit: PreparedSessions, arm: Arm, calibration: Calibration | None
) -> PreparedSessions:
    """Split placements where the artefact moved, and make the model under test of the parts."""
    if not unsplit.touched or unsplit.fitted is None:
        return unsplit
    parted = split_placements(unsplit.rests, unsplit.touched)
    baseline, inconsistent = make_model_and_judge_sessions(parted, arm, calibration)
    return replace(
        unsplit,
        sessions=parted,
        rests=collect_rests(parted, arm),
        baseline=baseline,
        inconsistent=inconsistent,
        fitted=None,
    )


def _make_search(
    prepared: PreparedSessions,
    arm: Arm,
    progress: TellShare,
    work: WorkBudget,
    refuted: Sequence[Candidate] = (),
) -> Search:
    """Make a search of prepared sessions; *refuted*: causes that are excluded."""
    drop_freed()
    held_out, barred = partial(compare_heldout, arm=arm), partial(is_refuted, refuted=refuted)
    return Search(prepared.rests, arm, prepared.baseline, progress, held_out, work, barred)


def _is_explained(
    prepared: PreparedSessions,
    search: Search,
    inconsistent: InconsistentSession,
    without: SearchOutcome,
) -> bool:
    """Whether a few causes explain the session that does not fit the others."""
    fitted = search.fit_forward(MOST_EXPLAINING, prepared.fitted or search.first_fit)
    if has_clearly_lower_noise(without.result.searched, fitted):
        return False
    return not is_farther_off(fitted, inconsistent.path)


def _search(
    prepared: PreparedSessions,
    search: Search,
    arm: Arm,
    progress: TellShare,
    work: WorkBudget,
    refuted: Sequence[Candidate] = (),
) -> SearchOutcome:
    """Run a search of prepared sessions, and perhaps another one beside older causes."""
    progress("search", 0.0)
    baseline, result = prepared.baseline, search.run()
    older = allow_absorbed_error(result.searched, arm)
    if older is not None and not work.may_go_on:
        work.skip("the search beside what the calibration may have absorbed")
    elif older is not None:
        beside_older = replace(prepared, baseline=older)
        another = _make_search(beside_older, arm, progress, work, refuted)
        repeated = another.run()
        if may_replace(repeated, result, arm):
            baseline, search, result = older, another, repeated
    return SearchOutcome(prepared, baseline, result, search.survey.parted)


def find_outliers(current: Fit) -> tuple[I64, float]:
    """Return the rests that are outliers by the rule of `armd calibrate`, and the smallest p value.

    The p value is family-wise.
    """
    rests = current.linear.rests
    squares = current.noise.squares(current.rest_residual_mm)
    region = find_regions(find_far_off(squares, DOWNWEIGHT_CHI2), rests.observations.states.q)
    return select_outliers(squares, region)

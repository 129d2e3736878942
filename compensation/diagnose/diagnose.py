"""What a model gets wrong, why, and the gain of mending it: the whole of `armd diagnose`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from armd.arrays import I64, Mask
from armd.compensation.data.session import Session
from armd.compensation.data.soundness import make_sound
from armd.compensation.diagnose.diagnosis import (
    Diagnosis,
    Finding,
    Gain,
    Outlier,
    SearchResult,
)
from armd.compensation.diagnose.extend import extended
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.fitting.follow import followed
from armd.compensation.diagnose.fitting.growth_open import told_of_growth
from armd.compensation.diagnose.fitting.outliers import find_outliers
from armd.compensation.diagnose.heldout.borne_out import (
    BorneOut,
    by_placement,
    by_session,
    on_sessions,
)
from armd.compensation.diagnose.heldout.cross_validation import cross_validate
from armd.compensation.diagnose.heldout.gain import gain, gains, groups_of
from armd.compensation.diagnose.heldout.left_open import saying_what_is_open
from armd.compensation.diagnose.heldout.refuted import (
    MOST_REPEATED,
    predicts_better,
    refuted_findings,
    refuted_in_words,
)
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Rests
from armd.compensation.diagnose.problem.rests import gather_rests, require_spare
from armd.compensation.diagnose.search.work import Work
from armd.compensation.diagnose.searched import Searched, search_sessions, search_without
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.observations import gather
from armd.compensation.freed import give_back_freed
from armd.compensation.identify.admission.mistakes import AssumedModel
from armd.compensation.identify.admission.wrong_names import told_of_misnamed
from armd.compensation.identify.evaluation.evaluate import Evaluation, evaluate
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
    """Diagnose *sessions* under a calibration, or under what `armd calibrate` makes of them.

    Raises `BadInput` where the sessions cannot be calibrated.
    """
    # The matrices are small: threads of the library's own cost more than they bring, and on a busy
    # machine very much more. Without, a result does not depend on the number of cores either.
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
    sessions, arm, told = sound.sessions, sound.arm, list(sound.told)
    if holdout:
        other = make_sound(holdout, arm)
        holdout, told = other.sessions, told + list(other.told)
    for some in filter(None, (sessions, holdout)):
        require_spare(gather_rests(some, arm).observations, ", ".join(str(s.path) for s in some))
    work = Work.of_readings(sum(session.n for session in sessions))
    searched, of_sessions = search_sessions(sessions, arm, calibration, progress, work)
    told += of_sessions
    diagnosis = _concluded(searched, arm, holdout, told, progress, work, command)
    refuted: tuple[Candidate, ...] = ()
    for _ in range(MOST_REPEATED):
        more = refuted_findings(diagnosis)
        if not more:
            break
        if not work.may_go_on:
            work.skip("the search without what held-out readings refute")
            told = [*diagnosis.told, *work.in_words()]
            return replace(diagnosis, told=tuple(told), skipped=tuple(work.skipped))
        refuted += more
        without = search_without(refuted, searched.given, arm, calibration, progress, work)
        why = [*told, refuted_in_words(refuted)]
        another = _concluded(without, arm, holdout, why, progress, work, command)
        if not predicts_better(another, diagnosis):
            break
        diagnosis = another
    return diagnosis


def _concluded(
    searched: Searched,
    arm: Arm,
    holdout: Sequence[Session],
    told: Sequence[str],
    progress: TellShare,
    work: Work,
    command: str,
) -> Diagnosis:
    """What a search found, judged by readings held out; *told*: what there is to say of these."""
    told = list(told)
    sessions, rests, baseline = searched.sessions, searched.rests, searched.baseline
    result, touched = searched.result, searched.touched
    if len(result.last.findings) == len(result.searched.findings):
        told += told_of_growth(baseline)
    told += told_of_misnamed(
        sessions,
        gather(sessions, arm, baseline.calibration.artefact),
        AssumedModel.under(arm, baseline.calibration),
    )
    give_back_freed()
    progress("gain", 0.9)
    last = result.last
    outlying, outlier_p = find_outliers(last)
    outliers = _named(outlying, rests, last)
    if holdout:  # in which no reading was named: none is left out
        progress("held out", 0.95)
        groups = groups_of(evaluate(holdout, arm, baseline.calibration).observations)
        written = by_session(result, arm, sessions, holdout, groups)
        squares = [
            on_sessions(step, arm, sessions, holdout, written.growth) for step in result.steps()
        ]
        kept = np.ones(len(groups), dtype=bool)
        measured = gains(squares, groups, kept)
    else:
        checked = cross_validate(result, searched.parted, arm, progress, work)
        searched.parted = None
        squares, groups = checked.squares, checked.groups
        kept = np.ones(rests.n, dtype=bool)
        kept[outlying] = False
        measured = gains(squares, groups, np.ones_like(kept))
        give_back_freed()
        progress("held out", 0.95)
        written = by_placement(result, arm, measured)
    measured = [
        replace(
            written.gains.get(i, g),
            shown=i in written.some or (found.candidate.told_only and g.shown),
        )
        for i, (found, g) in enumerate(zip(result.found, measured, strict=True))
    ]
    if not kept.all():
        clear = gains([square[kept] for square in squares], groups[kept], kept[kept])
        pairs = [(own.before_um, own.after_um) for own in clear]
        measured = [
            g if i in written.gains else replace(g, without_outliers_um=pair)
            for i, (g, pair) in enumerate(zip(measured, pairs, strict=True))
        ]
    result = replace(result, found=_doubted(result.found, written.doubts))
    told += work.in_words()
    if not last.noise.settled:
        told.append("The estimate of the noise did not settle: all probabilities are in doubt.")
    extension = _extension(written, result, rests, arm, sessions, command)
    repeated = holdout or not written.growth  # the search repeated without readings has no growth
    if len(written.some) == len(result.found) and not written.gains and repeated:
        written = replace(written, after=squares[-1])  # of a search repeated, where there is one
    return Diagnosis(
        arm,
        tuple(sessions),
        tuple(holdout),
        baseline,
        result,
        _rms_um(evaluate(sessions, arm, baseline.calibration)),
        1e3 * float(np.sqrt(squares[0].mean())),
        last.noise_floor_um,
        _rms_um(evaluate(sessions, arm, extension)),
        tuple(measured),
        outliers,
        outlier_p,
        gain(squares[-1], squares[-1], groups, kept) if outliers else None,
        written.some,
        _before_and_after_um(written, np.ones_like(kept)),
        None if kept.all() else _before_and_after_um(written, kept),
        written.unforeseen,
        written.by,
        extension,
        tuple(told),
        touched,
        _gain_of_parting(searched.given, sessions, arm, baseline.calibration) if touched else None,
        tuple(work.skipped),
    )


def _gain_of_parting(
    given: Sequence[Session], parted: Sequence[Session], arm: Arm, calibration: Calibration
) -> Gain:
    """Of placements that were touched: as one pose, and as two, under the same model."""
    whole, apart = (evaluate(some, arm, calibration) for some in (given, parted))
    squares = [(one.residual_mm**2).sum(axis=1) for one in (whole, apart)]
    return gain(squares[0], squares[1], groups_of(whole.observations))


def _before_and_after_um(written: BorneOut, kept: Mask) -> tuple[float, float]:
    before, after = (1e3 * float(np.sqrt(s[kept].mean())) for s in (written.before, written.after))
    return before, after


def _extension(
    written: BorneOut,
    result: SearchResult,
    rests: Rests,
    arm: Arm,
    sessions: Sequence[Session],
    command: str,
) -> Calibration:
    """The calibration with what is written of the findings; with none, it predicts what the one
    under test does."""
    last, some = result.last, written.some
    lost = any(session.lost_links for session in rests.sessions)
    if last.findings and lost and not last.baseline.held:
        # In the search the lengths of a link without a sensor are free in each session, and nothing
        # tells its expansion. What is written has that which the calibration under test has: by
        # the mean of the other sensors, as far as that goes.
        tied = tuple(replace(session, lost_links=()) for session in rests.sessions)
        rests, start = replace(rests, sessions=tied), last.baseline.model
        last = fit(
            rests, arm, last.baseline, start, last.findings, last.amplitudes, noise=last.noise
        )
    model = last
    if len(some) < len(last.findings):
        model = fit(
            rests,
            arm,
            last.baseline,
            last.model,
            [last.findings[i] for i in some],
            [last.amplitudes[i] for i in some],
            noise=last.noise,
        )
    left_out = [c for i, c in enumerate(last.findings) if i not in some]
    model = followed(model, arm)
    calibration = extended(model, arm, sessions, command, left_out, written.growth)
    return saying_what_is_open(calibration, last, some, arm, sessions)


def _doubted(found: Sequence[Finding], doubts: Mapping[int, float]) -> tuple[Finding, ...]:
    """With the odds of what readings held out speak against lowered."""
    told = []
    for i, finding in enumerate(found):
        odds, p = doubts.get(i, 1.0), finding.probability
        told.append(replace(finding, probability=p * odds / (p * odds + 1.0 - p)))
    return tuple(told)


def _rms_um(found: Evaluation) -> float:
    return float(np.sqrt((found.distance_um**2).mean()))


def _named(rests: I64, of: Rests, last: Fit) -> tuple[Outlier, ...]:
    lengths = [s.n for s in of.sessions]
    first = np.concatenate([[0], np.cumsum(lengths)])
    named = []
    for rest in rests:
        error = 1e3 * float(np.linalg.norm(last.left_mm[rest]))
        for reading in np.flatnonzero(of.rest_of == rest):
            session = int(np.searchsorted(first, reading, side="right")) - 1
            row = int(of.sessions[session].row[reading - first[session]]) + 1
            named.append(Outlier(of.sessions[session].name, row, error))
    return tuple(named)

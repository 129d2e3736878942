"""The searches of one diagnosis: without the sessions that fit no others, each artefact unmoved.

A session of another arm spreads its error over all causes, and the search names as many of them as
it may. So sessions that do not fit the others are looked for first; the others are searched without
them. One that a few causes explain comes back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from armd.compensation.data.session import Session
from armd.compensation.diagnose.diagnosis import SearchResult, Touched
from armd.compensation.diagnose.fitting.taken_up import beside_what_it_took_up
from armd.compensation.diagnose.fitting.under_test import model_under_test
from armd.compensation.diagnose.heldout.refuted import is_refuted
from armd.compensation.diagnose.heldout.sets import better_by
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Baseline, Rests
from armd.compensation.diagnose.problem.rests import gather_rests
from armd.compensation.diagnose.scoring.candidates import PartedSurvey
from armd.compensation.diagnose.search.again import counts_instead, no_surer, quieter
from armd.compensation.diagnose.search.search import Search
from armd.compensation.diagnose.search.touched import MOST_TOUCHED, beside, find_touched
from armd.compensation.diagnose.search.work import Work
from armd.compensation.effects.effect import Candidate
from armd.compensation.freed import give_back_freed
from armd.compensation.identify.admission.odd_session import Odd
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.progress import TellShare

#: Causes that may explain a session which does not fit the others.
MOST_EXPLAINING = 6
#: Its middle reading is then no more than so many times as far off as the middle one of the others.
AS_FAR_OFF = 3.0


@dataclass
class Searched:
    """What the last search had and found, and what was mended before it."""

    given: tuple[Session, ...]  # with every placement whole
    sessions: tuple[Session, ...]  # with those parted in which the artefact was moved
    rests: Rests
    baseline: Baseline
    result: SearchResult
    parted: PartedSurvey | None  # many megabytes: given up when they are not needed any more
    touched: tuple[Touched, ...]


def search_sessions(
    sessions: Sequence[Session],
    arm: Arm,
    calibration: Calibration | None,
    progress: TellShare,
    work: Work,
) -> tuple[Searched, list[str]]:
    """Search the sessions that fit each other; and what is reported of the others."""
    told, strange = list[str](), list[Odd]()
    consistent = tuple(sessions)
    of_all, odd = model_under_test(consistent, arm, calibration)
    baseline = of_all
    while odd is not None:
        strange.append(odd)
        consistent = _but(consistent, odd)
        baseline, odd = model_under_test(consistent, arm, calibration)
    searched = _search(consistent, arm, calibration, progress, work, baseline)
    inexplicable = []
    for odd in strange:
        told.append(odd.in_words())
        others = [other for other in strange if other is not odd]
        own, begin = _but(sessions, *others), None if others else of_all
        if not _explains(own, odd, searched, arm, calibration, progress, work, begin):
            inexplicable.append(odd)
            told.append(f"no cause explains session {odd.path.name}: the diagnosis is without it")
    if len(inexplicable) < len(strange):
        explained = _but(sessions, *inexplicable)
        searched = _search(explained, arm, calibration, progress, work)
    return searched, told


def search_without(
    refuted: Sequence[Candidate],
    given: Sequence[Session],
    arm: Arm,
    calibration: Calibration | None,
    progress: TellShare,
    work: Work,
) -> Searched:
    """Search the sessions of a search once more, without what held-out readings refuted."""
    return _search(given, arm, calibration, progress, work, refuted=refuted)


def _but(sessions: Sequence[Session], *strange: Odd) -> tuple[Session, ...]:
    """The sessions without those that do not fit the others."""
    paths = {odd.path for odd in strange}
    return tuple(session for session in sessions if session.path not in paths)


def _explains(
    sessions: Sequence[Session],
    odd: Odd,
    without: Searched,
    arm: Arm,
    calibration: Calibration | None,
    progress: TellShare,
    work: Work,
    begin: Baseline | None,
) -> bool:
    """Whether a few causes explain the session that does not fit the others."""
    parted = tuple(sessions)
    for _ in range(MOST_TOUCHED + 1):
        rests = gather_rests(parted, arm)
        baseline = begin or model_under_test(parted, arm, calibration)[0]
        begin = None
        progress(f"session {odd.path.name}", 0.0)
        search = Search(rests, arm, baseline, progress, work=work)
        touched = find_touched(search.first)
        if touched is None:
            break
        parted = touched.sessions
    fitted = search.explain(MOST_EXPLAINING)
    if quieter(without.result.searched, fitted):
        return False
    number = next(k for k, session in enumerate(parted) if session.path == odd.path)
    return not _is_farther_off(fitted, number)


def _is_farther_off(fitted: Fit, number: int) -> bool:
    """Whether the middle reading of a session lies clearly farther off than that of the others.

    Where one session in ten is another arm's, its readings are tails of a noise that the others
    make.
    """
    square = (fitted.noise.whiten_rests(fitted.left_mm) ** 2).sum(axis=1)
    own = fitted.linear.rests.observations.session == number
    return bool(np.median(square[own]) > AS_FAR_OFF**2 * np.median(square[~own]))


def _search(
    given: Sequence[Session],
    arm: Arm,
    calibration: Calibration | None,
    progress: TellShare,
    work: Work,
    begin: Baseline | None = None,
    refuted: Sequence[Candidate] = (),
) -> Searched:
    """The last of the searches that follow each other until no artefact was moved, without what is
    *refuted*."""
    sessions, touched = tuple(given), list[Touched]()
    while True:
        rests = gather_rests(sessions, arm)
        if begin is None or touched:
            begin, _ = model_under_test(sessions, arm, calibration)
        baseline = begin
        give_back_freed()
        progress("search", 0.0)
        held_out, barred = partial(better_by, arm=arm), partial(is_refuted, refuted=refuted)
        search = Search(rests, arm, baseline, progress, held_out, work, barred)
        found = find_touched(search.first) if len(touched) < MOST_TOUCHED else None
        if found is None:
            result = search.run()
            older = beside_what_it_took_up(result.searched, arm)
            if older is not None and not work.may_go_on:
                work.skip("the search beside what the calibration may have absorbed")
            elif older is not None:
                another = Search(rests, arm, older, progress, held_out, work, barred)
                again = another.run()
                if counts_instead(again, result, arm):
                    baseline, search, result = older, another, again
                else:
                    result = replace(result, found=no_surer(result.found, again))
            stepped = beside(result.searched, result.signatures, arm)
            if stepped is not None and len(touched) < MOST_TOUCHED:
                found = find_touched(stepped)
        if found is None:
            return Searched(
                tuple(given), sessions, rests, baseline, result, search.parted, tuple(touched)
            )
        touched.append(found)
        sessions = found.sessions

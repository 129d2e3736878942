"""Searches under the model to test, until nothing is left that only the readings are to blame for.

Where an artefact was moved, its placement is parted; where a session fits no other and no cause
explains why, it is left out. Each time the model under test is another one, and the search anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from armd.compensation.data.session import Session
from armd.compensation.diagnose.diagnosis import Finding, SearchResult, Touched
from armd.compensation.diagnose.fitting.growth_open import with_growth_open
from armd.compensation.diagnose.fitting.taken_up import beside_what_it_took_up
from armd.compensation.diagnose.heldout.sets import better_by
from armd.compensation.diagnose.problem.baseline import from_calibration
from armd.compensation.diagnose.problem.linear import Baseline, Rests
from armd.compensation.diagnose.problem.rests import gather_rests
from armd.compensation.diagnose.search.search import Search
from armd.compensation.diagnose.search.touched import MOST_TOUCHED, beside, find_touched
from armd.compensation.freed import give_back_freed
from armd.compensation.identify.admission.odd_session import Odd
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.progress import TellShare

#: A search leaves no more to the noise than another if its readings' own is at most so many times
#: as large. False causes made it smaller by 8 %, lost ones larger by a factor of 5.8.
AS_QUIET = 1.25


@dataclass(frozen=True)
class Settled:
    """The last search, what it had, and what was mended before it."""

    given: tuple[Session, ...]  # with every placement whole
    sessions: tuple[Session, ...]  # with those parted in which the artefact was moved
    rests: Rests
    baseline: Baseline
    search: Search
    result: SearchResult
    touched: tuple[Touched, ...]
    odd: Odd | None  # the session that does not fit the others
    told: tuple[str, ...] = ()


def search_settled(
    sessions: Sequence[Session], arm: Arm, calibration: Calibration | None, progress: TellShare
) -> Settled:
    """Search *sessions* under a calibration, or under what `armd calibrate` makes of them.

    Raises `BadInput` where they cannot be calibrated.
    """
    given, told = tuple(sessions), list[str]()
    settled = _with_touched_parted(given, arm, calibration, progress)
    while settled.odd:
        told.append(settled.odd.in_words())
        given = tuple(session for session in given if session.path != settled.odd.path)
        without = _with_touched_parted(given, arm, calibration, progress)
        if not _quieter(without.result, settled.result):
            break
        told.append(
            f"no cause explains what is other in session {settled.odd.path.name}: the diagnosis "
            "is without it"
        )
        settled = without
    return replace(settled, told=tuple(told))


def _with_touched_parted(
    given: tuple[Session, ...], arm: Arm, calibration: Calibration | None, progress: TellShare
) -> Settled:
    sessions, touched = given, list[Touched]()
    while True:
        rests = gather_rests(sessions, arm)
        baseline, odd = _under_test(sessions, arm, calibration)
        give_back_freed()
        progress("search", 0.0)
        search = Search(rests, arm, baseline, progress, partial(better_by, arm=arm))
        found = find_touched(search.first) if len(touched) < MOST_TOUCHED else None
        if found is None:
            result = search.run()
            older = beside_what_it_took_up(result.last, arm)
            if older is not None:
                another = Search(rests, arm, older, progress, partial(better_by, arm=arm))
                again = another.run()
                if _tells_less(again, result):
                    baseline, search, result = older, another, again
                else:
                    result = replace(result, found=_no_surer(result.found, again))
            stepped = beside(result.last, result.signatures, arm)
            if stepped is not None and len(touched) < MOST_TOUCHED:
                found = find_touched(stepped)
        if found is None:
            return Settled(
                given, tuple(sessions), rests, baseline, search, result, tuple(touched), odd
            )
        touched.append(found)
        sessions = found.sessions


def model_under_test(
    sessions: Sequence[Session], arm: Arm, calibration: Calibration | None
) -> Baseline:
    """The calibration given, held; otherwise what `armd calibrate` makes of the sessions.

    By itself that chooses a thermal model by its error: one that goes far would swallow causes that
    have a name (a link expanding in a curve, a joint that turns with temperature), and beside a
    strong error it chooses none, so that plain expansion would be found. The plain linear thermal
    model is the one under test wherever there can be one, and others are not tried.
    """
    return _under_test(sessions, arm, calibration)[0]


def _under_test(
    sessions: Sequence[Session], arm: Arm, calibration: Calibration | None
) -> tuple[Baseline, Odd | None]:
    """The model under test, and the session that does not fit the others of which it was made."""
    if calibration is not None:
        return with_growth_open(from_calibration(calibration, arm, held=True), arm), None
    made = calibrate(sessions, arm, Options(compare=False))
    return from_calibration(made.calibration, arm, held=False), made.odd


def _tells_less(again: SearchResult, before: SearchResult) -> bool:
    """Whether less was found *again* than *before*, and no more is left to the noise. The older
    causes are there still, so that it is not nothing."""
    return not _quieter(before, again) and 0 < len(again.found) < len(before.found)


def _quieter(one: SearchResult, other: SearchResult) -> bool:
    """Whether *one* leaves clearly less to the noise than the *other*."""
    return AS_QUIET * one.last.noise.own_mm <= other.last.noise.own_mm


def _no_surer(found: Sequence[Finding], again: SearchResult) -> tuple[Finding, ...]:
    """The findings no surer than *again*, where that found the same by name."""
    known = {of.candidate.place: of.probability for of in again.found}
    if sorted(f.candidate.place for f in found) != sorted(of.candidate.place for of in again.found):
        return tuple(found)
    lower = [min(f.probability, known[f.candidate.place]) for f in found]
    return tuple(replace(f, probability=p) for f, p in zip(found, lower, strict=True))

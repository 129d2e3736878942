"""The outcome of a search for the diagnosis, and a test of inconsistent sessions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.constants import AS_FAR_OFF
from armd.compensation.diagnose.diagnosis import MovedArtefact, SearchResult
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Baseline, Rests
from armd.compensation.diagnose.scoring.candidates import PartedSurvey
from armd.compensation.identify.admission.inconsistent_session import InconsistentSession


@dataclass(frozen=True)
class PreparedSessions:
    """Sessions before a search, and the model under test."""

    original_sessions: tuple[Session, ...]  # with every placement whole
    sessions: tuple[Session, ...]  # with placements split in which the artefact was moved
    rests: Rests
    baseline: Baseline
    inconsistent: InconsistentSession | None  # the session that does not fit the others
    touched: tuple[MovedArtefact, ...] = ()
    fitted: Fit | None = None  # to whole placements, with all steps; None if split


@dataclass
class SearchOutcome:
    """The data and the findings of the last search."""

    prepared: PreparedSessions
    baseline: Baseline
    result: SearchResult
    parted: PartedSurvey | None  # many megabytes: dropped when they are not needed any more


def drop_inconsistent(
    sessions: Sequence[Session], *strange: InconsistentSession
) -> tuple[Session, ...]:
    """Return the sessions without those that do not fit the others."""
    paths = {inconsistent.path for inconsistent in strange}
    return tuple(session for session in sessions if session.path not in paths)


def is_farther_off(fitted: Fit, path: Path) -> bool:
    """Whether the median reading of a session is clearly farther off than that of the others.

    The median is needed: where one session in ten is another arm's, its readings are only a tail of
    the noise that the others determine.
    """
    squared_norms, rests = fitted.noise.squares(fitted.rest_residual_mm), fitted.linear.rests
    paths = [session.path for session in rests.sessions]
    is_of_session = rests.observations.session == paths.index(path)
    return bool(
        np.median(squared_norms[is_of_session])
        > AS_FAR_OFF**2 * np.median(squared_norms[~is_of_session])
    )

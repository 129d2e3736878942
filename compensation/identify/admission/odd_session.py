"""The one session among several that does not fit the others, named by what is wrong with it.

A fit to all of them spreads its error over all. So each session is held against what the others
identify without it; where there are too few others, against the drawing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.data.session import Session
from armd.compensation.estimate.gauge import list_free_constants
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.admission.mistakes import (
    EXPLAINED,
    LEAST_FAHRENHEIT,
    LEAST_MM,
    LEAST_READINGS,
    AssumedModel,
    best_guess,
    celsius,
    miss_mm,
    misses_mm,
    wrong_length_unit,
)
from armd.compensation.identify.admission.requirements import readings_needed
from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import Identification, fit, rms_um
from armd.compensation.identify.thermal.temperatures import temperature_groups
from armd.compensation.identify.thermal.terms import length_terms
from armd.compensation.model.parameters import TIP_PARAMETERS
from armd.errors import BadInput

#: Of two that differ, nobody knows which is wrong.
LEAST_SESSIONS = 3
#: Under a drawing, readings that miss by more are no arm's; nor those that miss by so many times
#: what the best session does.
ABSURD_MM, APART = 20.0, 5.0
#: A fit that leaves more than this share of what the drawing leaves is worth the question.
SUSPICIOUS_SHARE = 0.1
#: So many sessions are left out in turn, those that miss most first; each costs a fit.
MOST_LEFT_OUT = 8
#: A session so far from the temperatures of all the others cannot be held against them closely: by
#: what it is farther, arms grow by no more than this share.
REACH_K, MOST_GROWN_PER_K = 3.0, 30e-6


@dataclass(frozen=True)
class Odd:
    """A session that does not fit, and nothing simple that would make it."""

    path: Path
    miss_mm: float
    others_mm: float
    #: how far from the others' its tip would have to be (3,), last frame, where that explains it;
    #: and by how much its readings then miss
    tip: tuple[F64, float] | None = None

    def in_words(self) -> str:
        words = (
            f"session {self.path.name} does not fit the others: its readings miss by up to "
            f"{_length(self.miss_mm)} under what the others identify, and theirs by up to "
            f"{_length(self.others_mm)}; "
        )
        if self.tip is None:
            return words + (
                "no unit, no exchanged targets or columns explain it. Is it another arm's, or did "
                "the arm change between the sessions (armd diagnose)?"
            )
        moved_mm, after_mm = self.tip
        x, y, z = (f"{mm:.3g}" for mm in moved_mm)
        return words + (
            f"with the tip moved by ({x}, {y}, {z}) mm in the last frame, by {_length(after_mm)}. "
            "Was it measured with another stylus, or one screwed in otherwise? One calibration "
            "holds one tip: leave the session out, or measure it again."
        )


def refuse_mistakes(
    sessions: Sequence[Session], observations: Observations, given: AssumedModel | None = None
) -> None:
    """Raise `BadInput` for sessions whose unit, names or columns are plainly others than they say.

    Held against *given*, a calibration, or the drawing, any such mistake stands out. *observations*
    are of *sessions*, some rows of them left out or none.
    """
    model = given or AssumedModel.under(observations.arm, None)
    parts = [observations.rows(observations.session == k) for k in range(len(sessions))]
    misses = np.array([miss_mm(part, model) for part in parts])
    told = misses > 0  # others have no placement with enough readings
    faults = []
    for session, part in zip(sessions, parts, strict=True):
        if unit := wrong_length_unit(part, model):
            found = f"certified distances that fit the arm if they are taken as {unit}"
            faults.append(BadInput(session.path, "the session", found, "distances in mm"))
    raise_all(faults)
    if not told.any():
        return
    suspects = told & (misses > min(ABSURD_MM, APART * max(misses[told].min(), LEAST_MM)))
    if not suspects.any():
        return
    by = "under the calibration given" if given else "under the drawing"
    others = ~suspects & told
    if not given and (better := identified(observations, others[observations.session])):
        model = AssumedModel.of(better)
        by = f"under what the other {int(others.sum())} identify"
    raise_all(
        [
            fault
            for k in map(int, np.flatnonzero(suspects))
            if (fault := mistake(sessions[k], parts[k], model, by))
        ]
    )


def inconsistent_session(sessions: Sequence[Session], observations: Observations) -> Odd | None:
    """Return the session without which the others fit, whatever the calibration of the arm.

    Raises `BadInput` where it is plain what is wrong with it.
    """
    if len(sessions) < LEAST_SESSIONS:
        return None
    found = identified(observations, np.ones(observations.n, dtype=bool))
    if found is None:
        return None
    arm = observations.arm
    drawn = evaluate_model(observations, arm.nominal(), [], arm.reference_temperature_c)
    return odd_session(sessions, found, rms_um(drawn.residual_mm))


def odd_session(
    sessions: Sequence[Session], found: Identification, drawn_rms_um: float
) -> Odd | None:
    """The session without which the others fit, asked where the fit to all of them is poor.

    Raises `BadInput` where it is plain what is wrong with it.
    """
    observations = found.observations
    model = AssumedModel.of(found)
    misses = _by_session(observations, model, len(sessions))
    if len(sessions) < LEAST_SESSIONS or not np.isfinite(misses).all():
        return None
    apart = misses.max() > APART * misses.min()
    hot = (observations.states.temperature_c > LEAST_FAHRENHEIT).any()
    if not apart and not hot and found.rms_um < SUSPICIOUS_SHARE * drawn_rms_um:
        return None
    best: tuple[float, int, AssumedModel] | None = None
    for k in map(int, np.argsort(-misses)[:MOST_LEFT_OUT]):
        rest = observations.session != k
        without = identified(observations, rest)
        if without is None:
            continue
        model = AssumedModel.of(without)
        level = float(np.nanmax(_by_session(observations.rows(rest), model, len(sessions))))
        if best is None or level < best[0]:
            best = (level, k, model)
    if best is None:
        return None
    level, k, model = best
    part = observations.rows(observations.session == k)
    miss = miss_mm(part, model)
    if miss < APART * level + _grown_mm(part, observations) or level > misses.max() / APART:
        return None
    by = f"under what the other {len(sessions) - 1} identify"
    if fault := mistake(sessions[k], part, model, by):
        raise fault
    return Odd(sessions[k].path, miss, level, _other_tip(part, model, miss))


def _other_tip(part: Observations, model: AssumedModel, miss: float) -> tuple[F64, float] | None:
    """How far the tip of a session would have to be from the *model*'s to explain that its
    readings *miss* it (mm), and by how much they then miss; None where it does not."""
    found = fit(part, model.constants, model.terms, Unknowns(TIP_PARAMETERS), model.reference_c)
    after = miss_mm(part, AssumedModel.of(found))
    at = part.arm.layout.tip
    return (found.constants[at] - model.constants[at], after) if after < EXPLAINED * miss else None


def raise_all(faults: list[BadInput]) -> None:
    if faults:
        faults[0].more = tuple(faults[1:])
        raise faults[0]


def mistake(session: Session, part: Observations, model: AssumedModel, by: str) -> BadInput | None:
    """What is plainly wrong with a session of the observations *part*, if anything; *by*: under
    what its readings miss."""
    guess = best_guess(part, model)
    if guess is None or guess[1] > ABSURD_MM:
        return None
    before, after = miss_mm(part, model), guess[1]
    found = (
        f"readings that miss by up to {_length(before)} {by}, and by {_length(after)} "
        f"if {guess[0].words}"
    )
    return BadInput(session.path, "the session", found, guess[0].expected)


def identified(observations: Observations, rows: Mask) -> Identification | None:
    """Constants, and lengths that grow with temperature where these rows' temperatures tell."""
    chosen = observations.rows(rows)
    if not rows.any() or chosen.n < readings_needed(chosen):
        return None
    arm = observations.arm
    finite = np.isfinite(chosen.states.temperature_c).all()
    terms = length_terms(arm, [1]) if finite and len(temperature_groups(chosen)) > 1 else []
    unknowns = Unknowns(list_free_constants(arm), range(len(terms)))
    return fit(chosen, arm.nominal(), terms, unknowns, arm.reference_temperature_c)


def _by_session(observations: Observations, model: AssumedModel, sessions: int) -> F64:
    """(S,) the largest miss of each session's placements; NaN where none is told."""
    misses = misses_mm(observations, model)
    counts = np.bincount(observations.placement, minlength=len(misses))
    largest = np.full(sessions, np.nan)
    for p in np.flatnonzero((counts >= LEAST_READINGS) & np.isfinite(misses)):
        k = observations.placement_session[p]
        largest[k] = np.fmax(largest[k], misses[p])
    return largest


def _grown_mm(part: Observations, observations: Observations) -> float:
    """What a session of the readings *part* may miss by for being colder or warmer than all others;
    0 within their reach."""
    rest = observations.rows(~np.isin(observations.session, part.session))
    own, others = part.states.temperature_c, rest.states.temperature_c
    if not (np.isfinite(own).all() and np.isfinite(others).all()) or not own.size:
        return 0.0
    low, high = others.min(axis=0) - REACH_K, others.max(axis=0) + REACH_K
    mean = own.mean(axis=0)
    beyond_k = min(
        float(np.maximum(np.maximum(low - c, c - high), 0.0).max()) for c in (mean, celsius(mean))
    )
    arm = observations.arm
    length_mm = float(np.abs(arm.nominal()[arm.layout.are_lengths]).sum())
    return MOST_GROWN_PER_K * length_mm * (beyond_k + REACH_K) if beyond_k else 0.0


def _length(mm: float) -> str:
    """As a person writes it."""
    return f"{mm:.3g} mm" if mm >= 0.1 else f"{1e3 * mm:.2g} µm"

"""Find the one session that does not fit the others, and what is wrong with it.

A fit to all sessions spreads its error over all of them. So each session is compared with what the
others identify without it. Where there are too few others, it is compared with the nominal
geometry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.data.sessions.session import Session
from armd.compensation.estimate.gauge import list_free_constants
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.admission.mistakes import (
    EXPLAINED,
    LEAST_FAHRENHEIT,
    LEAST_MISS_MM,
    LEAST_READINGS,
    AssumedModel,
    compute_largest_miss_mm,
    compute_misses_mm,
    find_best_guess,
    find_wrong_length_unit,
    to_celsius,
)
from armd.compensation.identify.admission.requirements import count_least_readings_for_observations
from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import Identification, compute_rms_um, fit
from armd.compensation.identify.thermal.temperatures import group_temperatures
from armd.compensation.identify.thermal.terms import make_length_terms
from armd.compensation.model.parameters import TIP_PARAMETERS
from armd.errors import BadInput, join_faults

#: With only two sessions that differ, it is not known which is wrong.
LEAST_SESSIONS = 3
#: A session is suspect under the nominal geometry if it misses by more than this many mm, or by
#: more than this many times the least miss of any session.
ABSURD_MM, MISFIT_RATIO = 20.0, 5.0
#: The search runs if a fit leaves more than this share of the RMS under the nominal geometry.
SUSPICIOUS_SHARE = 0.1
#: The most sessions that are left out in turn, those with the largest misses first; each costs a
#: fit.
MOST_LEFT_OUT = 8
#: A session whose temperatures lie outside the range of all others by more than REACH_K cannot be
#: compared closely. Beyond that range, lengths may grow by this share per K.
REACH_K, MOST_GROWN_PER_K = 3.0, 30e-6


@dataclass(frozen=True)
class InconsistentSession:
    """A session that does not fit the others and that no simple mistake explains."""

    path: Path
    miss_mm: float
    others_mm: float
    #: the offset (3,), last frame, of its tip from that of the others, if this explains the
    #: session; and the miss of its readings with that tip
    tip: tuple[F64, float] | None = None

    def in_words(self) -> str:
        words = (
            f"session {self.path.name} does not fit the others: its readings miss by up to "
            f"{_to_text(self.miss_mm)} under what the others identify, and theirs by up to "
            f"{_to_text(self.others_mm)}; "
        )
        if self.tip is None:
            return words + (
                "no unit, no exchanged targets or columns explain it. Is it another arm's, or did "
                "the arm change between the sessions (armd diagnose)?"
            )
        moved_mm, after_mm = self.tip
        x, y, z = (f"{mm:.3g}" for mm in moved_mm)
        return words + (
            f"with the tip moved by ({x}, {y}, {z}) mm in the last frame, by {_to_text(after_mm)}. "
            "Was it measured with another stylus, or one screwed in otherwise? One calibration "
            "holds one tip: leave the session out, or measure it again."
        )


def refuse_mistakes(
    sessions: Sequence[Session], observations: Observations, calibrated: AssumedModel | None = None
) -> None:
    """Raise `BadInput` for sessions with a plain mistake in a unit, in names or in columns.

    The sessions are compared with *calibrated*, or with the nominal geometry, where such mistakes
    are large. *observations* are of *sessions*; some rows may be missing.
    """
    model = calibrated or AssumedModel.from_calibration(observations.arm, None)
    parts = [observations.rows(observations.session == k) for k in range(len(sessions))]
    misses = np.array([compute_largest_miss_mm(part, model) for part in parts])
    is_judged = misses > 0  # the others have no placement with enough readings
    faults = []
    for session, part in zip(sessions, parts, strict=True):
        if unit := find_wrong_length_unit(part, model):
            problem = f"certified distances that fit the arm if they are taken as {unit}"
            faults.append(BadInput(session.path, "the session", problem, "distances in mm"))
    raise_all(faults)
    if not is_judged.any():
        return
    suspects = is_judged & (
        misses > min(ABSURD_MM, MISFIT_RATIO * max(misses[is_judged].min(), LEAST_MISS_MM))
    )
    if not suspects.any():
        return
    model_words = "under the calibration given" if calibrated else "under the drawing"
    is_reference = ~suspects & is_judged
    if not calibrated and (
        better := identify_rows(observations, is_reference[observations.session])
    ):
        model = AssumedModel.from_identification(better)
        model_words = f"under what the other {int(is_reference.sum())} identify"
    raise_all(
        [
            fault
            for k in map(int, np.flatnonzero(suspects))
            if (fault := find_mistake(sessions[k], parts[k], model, model_words))
        ]
    )


def fit_and_find_inconsistent_session(
    sessions: Sequence[Session], observations: Observations
) -> InconsistentSession | None:
    """Fit all sessions, and return the one without which the others fit.

    No calibration of the arm is needed. Raises `BadInput` where the mistake in the session is
    plain.
    """
    if len(sessions) < LEAST_SESSIONS:
        return None
    identification = identify_rows(observations, np.ones(observations.n, dtype=bool))
    if identification is None:
        return None
    arm = observations.arm
    drawn = evaluate_model(observations, arm.nominal(), [], arm.reference_temperature_c)
    return find_inconsistent_session(sessions, identification, compute_rms_um(drawn.residual_mm))


def find_inconsistent_session(
    sessions: Sequence[Session], identification: Identification, nominal_rms_um: float
) -> InconsistentSession | None:
    """Return the session without which the others fit, if the fit to all of them is poor.

    Raises `BadInput` where the mistake in the session is plain.
    """
    observations = identification.observations
    model = AssumedModel.from_identification(identification)
    misses = _find_largest_by_session(observations, model, len(sessions))
    if len(sessions) < LEAST_SESSIONS or not np.isfinite(misses).all():
        return None
    is_apart = misses.max() > MISFIT_RATIO * misses.min()
    hot = (observations.states.temperature_c > LEAST_FAHRENHEIT).any()
    if not is_apart and not hot and identification.rms_um < SUSPICIOUS_SHARE * nominal_rms_um:
        return None
    best: tuple[float, int, AssumedModel] | None = None
    for k in map(int, np.argsort(-misses)[:MOST_LEFT_OUT]):
        is_other = observations.session != k
        without = identify_rows(observations, is_other)
        if without is None:
            continue
        model = AssumedModel.from_identification(without)
        level = float(
            np.nanmax(_find_largest_by_session(observations.rows(is_other), model, len(sessions)))
        )
        if best is None or level < best[0]:
            best = (level, k, model)
    if best is None:
        return None
    level, k, model = best
    part = observations.rows(observations.session == k)
    miss = compute_largest_miss_mm(part, model)
    if (
        miss < MISFIT_RATIO * level + _estimate_growth_mm(part, observations)
        or level > misses.max() / MISFIT_RATIO
    ):
        return None
    model_words = f"under what the other {len(sessions) - 1} identify"
    if fault := find_mistake(sessions[k], part, model, model_words):
        raise fault
    return InconsistentSession(sessions[k].path, miss, level, _fit_other_tip(part, model, miss))


def _fit_other_tip(
    part: Observations, model: AssumedModel, miss: float
) -> tuple[F64, float] | None:
    """Fit a separate tip to a session whose readings *miss* (mm) under *model*.

    Return its offset (3,) from the model's tip and the remaining miss in mm; None where another tip
    does not explain the miss.
    """
    fitted = fit(part, model.constants, model.terms, Unknowns(TIP_PARAMETERS), model.reference_c)
    after = compute_largest_miss_mm(part, AssumedModel.from_identification(fitted))
    tip_slice = part.arm.layout.tip
    return (
        (fitted.constants[tip_slice] - model.constants[tip_slice], after)
        if after < EXPLAINED * miss
        else None
    )


def raise_all(faults: list[BadInput]) -> None:
    if faults:
        raise join_faults(faults)


def find_mistake(
    session: Session, part: Observations, model: AssumedModel, model_words: str
) -> BadInput | None:
    """Return the plain mistake in the observations *part* of a session, or None.

    *model_words* describes the model under which the readings miss, for the message.
    """
    guess = find_best_guess(part, model)
    if guess is None or guess[1] > ABSURD_MM:
        return None
    before, after = compute_largest_miss_mm(part, model), guess[1]
    problem = (
        f"readings that miss by up to {_to_text(before)} {model_words}, and by {_to_text(after)} "
        f"if {guess[0].words}"
    )
    return BadInput(session.path, "the session", problem, guess[0].expected)


def identify_rows(observations: Observations, rows: Mask) -> Identification | None:
    """Fit the constants, and expansion of the lengths if these rows have several temperatures.

    Return None if there are too few readings.
    """
    chosen = observations.rows(rows)
    if not rows.any() or chosen.n < count_least_readings_for_observations(chosen):
        return None
    arm = observations.arm
    finite = np.isfinite(chosen.states.temperature_c).all()
    terms = make_length_terms(arm, [1]) if finite and len(group_temperatures(chosen)) > 1 else []
    unknowns = Unknowns(list_free_constants(arm), range(len(terms)))
    return fit(chosen, arm.nominal(), terms, unknowns, arm.reference_temperature_c)


def _find_largest_by_session(observations: Observations, model: AssumedModel, sessions: int) -> F64:
    """Return the largest miss (S,) of each session's placements; NaN where none can be judged."""
    misses = compute_misses_mm(observations, model)
    counts = np.bincount(observations.placement, minlength=len(misses))
    largest = np.full(sessions, np.nan)
    for p in np.flatnonzero((counts >= LEAST_READINGS) & np.isfinite(misses)):
        k = observations.placement_session[p]
        largest[k] = np.fmax(largest[k], misses[p])
    return largest


def _estimate_growth_mm(part: Observations, observations: Observations) -> float:
    """Return the miss, mm, that expansion explains in a session colder or warmer than all others.

    *part* holds the session's readings. The result is 0 within `REACH_K` of the others'
    temperatures.
    """
    other_sessions = observations.rows(~np.isin(observations.session, part.session))
    own_c, others_c = part.states.temperature_c, other_sessions.states.temperature_c
    if not (np.isfinite(own_c).all() and np.isfinite(others_c).all()) or not own_c.size:
        return 0.0
    low, high = others_c.min(axis=0) - REACH_K, others_c.max(axis=0) + REACH_K
    mean = own_c.mean(axis=0)
    beyond_k = min(
        float(np.maximum(np.maximum(low - c, c - high), 0.0).max())
        for c in (mean, to_celsius(mean))
    )
    arm = observations.arm
    length_mm = float(np.abs(arm.nominal()[arm.layout.are_lengths]).sum())
    return MOST_GROWN_PER_K * length_mm * (beyond_k + REACH_K) if beyond_k else 0.0


def _to_text(mm: float) -> str:
    """Return a length in mm or µm, as a person writes it."""
    return f"{mm:.3g} mm" if mm >= 0.1 else f"{1e3 * mm:.2g} µm"

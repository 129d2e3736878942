"""The time discrepancy of findings, so that it is not taken for further causes.

No creep follows one of the courses exactly, and a random walk also moves between its knots. The
difference looks like a staircase: a few steps at instants follow any path. So while the search goes
on, each drift may also walk at random from its course, along the same parameters: as far as it went
in all (a walk), or by a share of that (a smooth course).

A link that follows its sensor late had some state before a session began, which nobody measured.
The model begins settled, as the daemon does. The resulting error fades in each session from its
start and looks like a drift of the link. Nor are all its lengths equally late: a length of the
model may also be another link's (a length along parallel axes), which is not late.
"""

from __future__ import annotations

import math

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import (
    LEAST_UNEVEN,
    MOST_FUNCTIONS,
    ROUNDING,
    WALK_MOMENTS,
    WALK_RANGE,
)
from armd.compensation.diagnose.problem.linear import Linear
from armd.compensation.diagnose.problem.whitening import RestNoise
from armd.compensation.effects.courses import (
    OF_A_COURSE,
    OF_A_WALK,
    compute_swing,
    is_drift,
    is_walk,
)
from armd.compensation.effects.effect import Candidate, Column, tie
from armd.compensation.effects.location import make_shape_location
from armd.compensation.effects.thermal.thermal_lag import LONGER_LAGS, OF_A_LENGTH, SLOWER_LAGS
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.slow_factors import After, Period, Relaxation, Temperature
from armd.compensation.model.terms import Factor, Term


def make_time_discrepancy_columns(
    linear: Linear, noise: RestNoise, finding: Candidate, amplitudes: F64, arm: Arm
) -> F64:
    """Make the columns (N, m) in mm of a finding's time discrepancy, for amplitudes of unit
    variance.

    A finding that is neither a drift nor a lag has none. Columns that show too little are dropped.
    """
    if not may_have_time_discrepancy(finding):
        return np.zeros((len(linear.residual), 0))
    make_columns = _unsettled if is_unsettled_at_start(finding) else _strayed
    columns = np.stack(make_columns(linear, finding, amplitudes, arm), axis=1)
    visible: F64 = columns[:, np.linalg.norm(noise.whiten(columns), axis=0) > LEAST_UNEVEN]
    return visible


def may_have_time_discrepancy(finding: Candidate) -> bool:
    """Whether a finding is a lag, or a drift in time alone."""
    return is_unsettled_at_start(finding) or (is_drift(finding) and _of_time_alone(finding))


def _strayed(linear: Linear, drift: Candidate, amplitudes: F64, arm: Arm) -> list[F64]:
    share = (OF_A_WALK if is_walk(drift) else OF_A_COURSE) / WALK_RANGE
    functions = _principal(linear.rests.observations.states.time_s)
    columns = []
    for group in _together(drift):
        sizes = [share * compute_swing(drift, amplitudes, name) for name in group]
        # Parameters of one kind (a base's shifts) differ by chance: each may stray as far.
        common_size = float(np.sqrt(np.mean(np.square(sizes))))
        for name in group:
            index = arm.layout.index(name)
            columns += [common_size * linear.signature(index, values) for values in functions.T]
    return columns


def is_unsettled_at_start(finding: Candidate) -> bool:
    """Whether a finding depends on its state before a session began, which nobody measured."""
    return finding.cause == "thermal_lag"


def has_unknown_initial_state(finding: Candidate) -> bool:
    """Whether a finding is weighed with the starts of its sessions open: a lag of lengths.

    A lag of angles goes by a difference of two links. With its starts open, a lag of one link would
    act like a lag of the other.
    """
    terms = (term for column in finding.columns for term in column.terms)
    return is_unsettled_at_start(finding) and not any(_turns(term.parameter) for term in terms)


def make_initial_state_candidate(
    linear: Linear, lag: Candidate, amplitudes: F64, arm: Arm
) -> Candidate:
    """Make a candidate of what fades in each session, with amplitudes of unit variance."""
    observations = linear.rests.observations
    largest_mm = [(name, mm) for name, (_, mm) in _behind(linear, lag, amplitudes, arm).items()]
    numbers = np.unique(observations.session)
    times = [observations.states.time_s[observations.session == number] for number in numbers]
    sessions = sorted((float(time_s.min()), float(time_s.max())) for time_s in times)
    columns = []
    for (start_s, end_s), after in zip(sessions, [*sessions[1:], None], strict=True):
        for longer in LONGER_LAGS:
            pieces = _fading(start_s, end_s, after and after[0], longer * lag.setting[0][1])
            terms = [
                term
                for share, factor in pieces
                for term in tie([(name, share * mm) for name, mm in largest_mm], factor)
            ]
            columns.append(Column("what fades", "1", 1.0, tuple(terms), reach=1.0))
    return Candidate(
        "unknown", make_shape_location(lag.cause, lag.location), tuple(columns), lag.depends_on
    )


def _fading(
    start_s: float, end_s: float, after_s: float | None, time_constant_s: float
) -> list[tuple[float, Factor]]:
    """Return factors that sum to 1 at a session's start, fade from then on, and end at the next
    start.
    """
    settles = Relaxation(since_unix_s=start_s, until_unix_s=end_s, time_constant_s=time_constant_s)
    pieces: list[tuple[float, Factor]] = [(1.0, After(instant_unix_s=start_s)), (-1.0, settles)]
    if after_s is not None:
        remaining = math.exp(-(end_s - start_s) / time_constant_s)
        pieces.append((-remaining, After(instant_unix_s=after_s)))
    return pieces


def _unsettled(linear: Linear, lag: Candidate, amplitudes: F64, arm: Arm) -> list[F64]:
    """Return columns that fade in each session from its start on, and columns of single lengths.

    A fading column is at first as large as the link is ever late. With several lengths, each also
    has a lateness of its own.
    """
    observations = linear.rests.observations
    states = observations.states
    behind = _behind(linear, lag, amplitudes, arm)
    columns = []
    if len(behind) > 1:  # for a single length this is the lag itself
        columns += [
            OF_A_LENGTH * linear.signature(arm.layout.index(name), course)
            for name, (course, _) in behind.items()
        ]
    for session in np.unique(observations.session):
        own_rests = observations.session == session
        since_s = states.time_s - states.time_s[own_rests].min()
        for longer in LONGER_LAGS:
            fading = np.exp(-np.maximum(since_s, 0.0) / (longer * lag.setting[0][1])) * own_rests
            moved = [
                mm * linear.signature(arm.layout.index(name), fading)
                for name, (_, mm) in behind.items()
            ]
            columns.append(np.sum(moved, axis=0))
    return columns


def _behind(
    linear: Linear, lag: Candidate, amplitudes: F64, arm: Arm
) -> dict[str, tuple[F64, float]]:
    """Return for each length its course of lateness (n,) in mm, and the largest one with sign."""
    model = linear.model
    terms = lag.columns[0].terms  # for each length a late term, and the prompt one subtracted
    states = linear.rests.observations.states
    values = compute_basis_values(terms, states, arm, model.reference_c, model.constants)
    behind = {}
    for name in dict.fromkeys(term.parameter for term in terms):
        indices = [i for i, term in enumerate(terms) if term.parameter == name]
        course = amplitudes[0] * (
            values[:, indices] @ np.array([terms[i].coefficient for i in indices])
        )
        late = sum(terms[i].coefficient for i in indices if _is_late(terms[i]))
        largest_mm = float(np.copysign(np.abs(course).max(), late * amplitudes[0]))
        behind[name] = course, largest_mm
    return behind


def _is_late(term: Term) -> bool:
    return any(isinstance(factor, Temperature) and factor.lag_s for factor in term.basis)


def _of_time_alone(drift: Candidate) -> bool:
    bases = [term.basis for column in drift.columns for term in column.terms]
    return all(len(basis) == 1 and isinstance(basis[0], Period | After) for basis in bases)


def _together(drift: Candidate) -> list[list[str]]:
    """Group the parameters that a drift moves by their unit."""
    named = dict.fromkeys(term.parameter for column in drift.columns for term in column.terms)
    turns = [name for name in named if _turns(name)]
    return [group for group in (turns, [n for n in named if n not in turns]) if group]


def _turns(parameter: str) -> bool:
    return parameter.startswith(("theta", "alpha", "beta", "base_r"))


def _principal(time_s: F64) -> F64:
    """Return principal functions (n, m) of a random walk over the time seen, its end of unit
    variance.
    """
    times = np.unique(time_s)
    if len(times) > WALK_MOMENTS:
        times = times[np.linspace(0, len(times) - 1, WALK_MOMENTS).round().astype(int)]
    since = (times - times[0]) / max(float(times[-1] - times[0]), ROUNDING)
    values, vectors = np.linalg.eigh(np.minimum(since[:, None], since[None, :]))
    span = slice(-MOST_FUNCTIONS, None)
    scaled = vectors[:, span] * np.sqrt(np.maximum(values[span], 0.0))
    functions: F64 = np.stack([np.interp(time_s, times, column) for column in scaled.T], axis=1)
    return functions


def make_slower(candidate: Candidate) -> list[Candidate]:
    """Return the candidate with longer time constants if its sessions may begin in any state."""
    if not has_unknown_initial_state(candidate) or candidate.elsewhere is None:
        return []
    return [candidate.elsewhere(times * candidate.setting[0][1]) for times in SLOWER_LAGS]

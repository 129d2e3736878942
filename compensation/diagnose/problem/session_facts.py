"""Facts of the sessions that the catalogue may assume: which data there are, and when."""

from __future__ import annotations

import itertools

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import (
    LEAST_SPAN_K,
    LEVER_MM,
    MOST_INSTANTS,
    MOST_SPELLS,
    MOST_TELL,
    PAUSE,
    POSE_TARGETS,
)
from armd.compensation.diagnose.problem.linear import Baseline, Rests
from armd.compensation.effects.effect import SessionFacts
from armd.compensation.estimate.surface_kinds import POINT
from armd.compensation.model.arm import Arm


def collect_facts(rests: Rests, arm: Arm, baseline: Baseline) -> SessionFacts:
    """Collect the facts of these rests under the model under test."""
    observations = rests.observations
    states = observations.states
    temperatures = states.temperature_c
    # Given constants hold at the reference temperature: one other temperature is a change.
    usual = baseline.model.reference_c if baseline.is_given else None
    varied = np.isfinite(temperatures).all(axis=0) & (_span(temperatures, usual) > LEAST_SPAN_K)
    artefact_k, instead_k = (
        _span(rise, 0.0 if baseline.is_given else None)
        for rise in (rests.artefact_rise_c, rests.arm_rise_without_artefact_k)
    )
    timed = bool(np.isfinite(states.time_s).all())
    moments = _moments(states.time_s) if timed else np.empty(0)
    labels = np.array(rests.target_label)
    points = observations.kind[observations.target] == POINT
    certified = np.unique(labels[observations.target[~observations.has_truth & points]])
    named = [str(name) for name in certified if not observations.unknown[labels == name].any()]
    rate = states.rate[np.isfinite(states.rate)]
    return SessionFacts(
        arm=arm,
        constants=baseline.model.constants,
        terms=tuple(t for t in baseline.model.terms if t.coefficient),  # those that act
        reference_c=baseline.model.reference_c,
        has_fixed_constants=baseline.is_given,
        sensors=tuple(
            name
            for name, ok in zip(arm.sensors, varied, strict=True)
            if ok and not any(name in session.lost for session in rests.sessions)
        ),
        lost_links=frozenset(k for session in rests.sessions for k in session.lost_links),
        timed=timed,
        rates=bool(rate.size and np.any(rate != 0.0)),
        approach=bool(np.isfinite(states.approach).all(axis=1).mean() > MOST_TELL),
        artefact_c=bool(artefact_k > LEAST_SPAN_K),
        artefact_unread=bool(instead_k > LEAST_SPAN_K),
        artefacts=tuple(dict.fromkeys(s.artefact.name for s in rests.sessions)),
        targets=tuple(named) if len(named) > POSE_TARGETS else (),
        distances=_checked_distances(rests, baseline),
        start_unix_s=float(states.time_s.min()) if timed else 0.0,
        end_unix_s=float(states.time_s.max()) if timed else 0.0,
        spells_unix_s=_spells(states.time_s) if timed else (),
        sessions=_sessions(rests) if timed else (),
        instants_unix_s=_grid(moments),
        all_instants_unix_s=moments,
        scatter_rad=_scatter_rad(baseline),
        calibrated_c=_calibrated_c(baseline) if baseline.is_given else {},
        open_growth=frozenset(baseline.model.terms[i].parameter for i in baseline.growth),
    )


def _calibrated_c(baseline: Baseline) -> dict[str, tuple[float, ...]]:
    """Return a calibration's temperatures by sensor, its sessions evenly over its range."""
    sessions = baseline.calibration.provenance.get("sessions")
    count = max(len(sessions) if isinstance(sessions, list) else 0, 2)
    return {
        name: tuple(map(float, np.linspace(low, high, count)))
        for name, (low, high) in baseline.calibration.temperature_range_c.items()
    }


def _scatter_rad(baseline: Baseline) -> float:
    """Return a reading's scatter as an angle, from the noise of the calibration under test.

    If that calibration is given, the scatter is of the time before the change to be diagnosed.
    """
    noise = baseline.calibration.noise
    return float(np.hypot(max(noise.encoder_rad, default=0.0), noise.reading_mm / LEVER_MM))


def _span(temperature: F64, usual: float | None) -> F64:
    """Return highest less lowest of temperatures (n, …), the *usual* one included."""
    if usual is not None:
        temperature = np.concatenate([temperature, np.full_like(temperature[:1], usual)])
    span: F64 = np.ptp(temperature, axis=0)
    return span


def _checked_distances(rests: Rests, baseline: Baseline) -> tuple[str, ...]:
    """List the certified distances that another known length can contradict.

    With constants free and only one distance known, an arm shrunk to nothing would leave no
    residual at all: the data cannot decide whether that distance is right.
    """
    observations = rests.observations
    between = observations.distances.between
    positions = observations.has_truth.any() or observations.says_size.any()
    if not (baseline.is_given or positions or len(between) > 1):
        return ()
    labels = rests.target_label
    return tuple(f"{labels[a]}, {labels[b]}" for a, b in between)


def _spells(time_s: F64) -> tuple[tuple[float, float], ...]:
    """Return first and last reading of each spell between the longest pauses."""
    times = np.unique(time_s)
    gaps_s = np.diff(times)
    pauses = np.flatnonzero(gaps_s > PAUSE * np.median(gaps_s)) if len(gaps_s) else np.empty(0, int)
    pauses = np.sort(pauses[np.argsort(-gaps_s[pauses])][: MOST_SPELLS - 1])
    starts, ends = times[[0, *(pauses + 1)]], times[[*pauses, -1]]
    return tuple((float(a), float(b)) for a, b in zip(starts, ends, strict=True) if b > a)


def _sessions(rests: Rests) -> tuple[tuple[str, float, float], ...]:
    """Return name, first and last reading of each session in order of time; none if two overlap."""
    observations = rests.observations
    sessions = []
    for number, name in enumerate(observations.session_names):
        own_s = observations.states.time_s[observations.session == number]
        if len(own_s):
            sessions.append((name, float(own_s.min()), float(own_s.max())))
    sessions.sort(key=lambda session: session[1])
    are_disjoint = all(
        session[2] < following[1] for session, following in itertools.pairwise(sessions)
    )
    return tuple(sessions) if are_disjoint else ()


def _moments(time_s: F64) -> F64:
    """Return the times halfway between successive rests."""
    times = np.unique(time_s)
    halfway: F64 = (times[1:] + times[:-1]) / 2
    return halfway


def _grid(moments: F64) -> tuple[float, ...]:
    """Pick moments spread evenly over the readings, not over the hours."""
    if len(moments) <= MOST_INSTANTS:
        return tuple(map(float, moments))
    picked = np.linspace(0, len(moments) - 1, MOST_INSTANTS + 2).round().astype(int)[1:-1]
    return tuple(map(float, moments[np.unique(picked)]))

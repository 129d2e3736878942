"""The tip differs from the calibration: at all times, or from a moment on.

It may be displaced in any direction. A stylus that loosens in its thread, or was not screwed in
completely, moves along its shaft, which is nearly the last axis. A last joint that slid has the
same effect. An operator who presses harder than others moves the tip along the stylus, in his own
sessions.
"""

import math
from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.by_session import (
    compute_values_by_session,
    is_by_session,
    make_column,
    make_session_functions,
)
from armd.compensation.effects.courses import (
    Function,
    compute_swing,
    describe_course,
    is_drift,
    make_drifts,
    make_steps,
)
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    Effect,
    SessionFacts,
    describe_instant,
    list_stylus_offsets,
    tie,
)
from armd.compensation.model.parameters import TIP_PARAMETERS
from armd.compensation.model.slow_factors import After
from armd.compensation.wording import format_plain

TYPICAL_MM = 20e-3
#: The part across the last axis if the tip moved along its shaft: a thread is askew by some
#: degrees.
ASKEW = 0.2


def _columns(*basis: After, across: float = 1.0) -> tuple[Column, ...]:
    prior_sd = {"x": across * TYPICAL_MM, "y": across * TYPICAL_MM, "z": TYPICAL_MM}
    return tuple(
        Column(axis, "mm", size, tie([(f"tip_{axis}", 1.0)], *basis))
        for axis, size in prior_sd.items()
    )


def _along(function: Function) -> list[Column]:
    prior_sd = TYPICAL_MM / function.largest
    return [
        Column(
            f"{axis} {function.name}",
            "mm" + function.per,
            prior_sd,
            function.terms([(f"tip_{axis}", 1.0)]),
        )
        for axis in "xyz"
    ]


def _in_each_session(facts: SessionFacts) -> Iterator[Candidate]:
    """Yield candidates with an offset for each session: in any direction, or along the
    stylus only.
    """
    functions, stylus_lengths = make_session_functions(facts), list_stylus_offsets(facts)
    length = math.hypot(*(mm for _, mm in stylus_lengths))
    anywhere = {name[-1]: [(name, 1.0)] for name in TIP_PARAMETERS}
    along = (
        {"along the stylus": [(name, mm / length) for name, mm in stylus_lengths]}
        if stylus_lengths
        else {}
    )
    for motions in (anywhere, along):
        columns = [
            make_column(function, motion, "mm", TYPICAL_MM, weights)
            for function in functions
            for motion, weights in motions.items()
        ]
        if columns:
            yield Candidate("tip_offset", location.TIP, tuple(columns), ("time_s",))


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    if facts.has_fixed_constants:
        yield Candidate("tip_offset", location.TIP, _columns(), ())
        yield Candidate("tip_offset", location.TIP, _columns(across=ASKEW), ())
    yield from make_steps(facts, "tip_offset", location.TIP, _columns)
    yield from make_drifts(facts, "tip_offset", location.TIP, _along)
    yield from _in_each_session(facts)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    if is_by_session(candidate):
        return _read_by_session(candidate, amplitudes)
    if is_drift(candidate):
        extent_mm = max(compute_swing(candidate, amplitudes, f"tip_{axis}") for axis in "xyz")
        extent_um = format_plain(extent_mm * 1e3)
        return f"the tip {describe_course(candidate)}, by {extent_um} µm in the time seen"
    moved = ", ".join(format_plain(value, 3, "+") for value in amplitudes * 1e3)
    return f"the tip has moved by ({moved}) µm in the last frame{describe_instant(candidate)}"


def _read_by_session(candidate: Candidate, amplitudes: F64) -> str:
    values, against = compute_values_by_session(candidate, amplitudes)
    along = all(len(offset_mm) == 1 for _, offset_mm in values)
    offsets = ", ".join(
        f"{name} {1e3 * offset_mm[0]:+.0f} µm"
        if along
        else f"{name} {1e3 * np.linalg.norm(offset_mm):.0f} µm"
        for name, offset_mm in values
    )
    direction = " along the stylus" if along else ""
    return (
        f"the tip stands otherwise from session to session{direction}: {offsets} against {against}"
    )


EFFECT = Effect(
    "tip_offset",
    "the tip was changed, loosened or worn, or somebody presses harder than others",
    "constants of the last joint",
    "measure one seat from ten directions",
    list_candidates,
    describe,
    "the time of each reading (time_s), or a calibration to compare with",
    accident=True,
)

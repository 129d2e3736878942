"""The base moves with time, or steps."""

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
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
    tie,
)
from armd.compensation.model.slow_factors import After, Time
from armd.compensation.wording import ARC_SECOND, format_plain, seconds_of_arc

#: 1; a larger step of a mount, in multiples of its typical 5 µm and 4″, in one placement only, is a
#: moved artefact. Both have the same signature, and only their sizes differ.
MOST_MOUNT_STEP = 2.0

SHIFTS = ("base_x", "base_y", "base_z")
#: Typical motions of a base over the time seen.
TYPICAL_MM, TYPICAL_RAD = 20e-3, 15 * ARC_SECOND
TURNS = ("base_rx", "base_ry", "base_rz")


def _columns(basis: After | Time, per: str = "") -> tuple[Column, ...]:
    shifts = [Column(n, "mm" + per, 5e-3, tie([(n, 1.0)], basis)) for n in SHIFTS]
    turns = [Column(n, "rad" + per, 4 * ARC_SECOND, tie([(n, 1.0)], basis)) for n in TURNS]
    return (*shifts, *turns)


def make_steady_drift(facts: SessionFacts) -> Candidate:
    """Make a drift of the base at one rate over the time seen; outside of it nothing is assumed."""
    elapsed = Time(since_unix_s=facts.start_unix_s, until_unix_s=facts.end_unix_s)
    columns = _columns(elapsed, "/h")
    return Candidate("mount_drift", location.BASE, columns, ("time_s",))


def _along(function: Function) -> list[Column]:
    def column(name: str, unit: str, prior_sd: float) -> Column:
        terms = function.terms([(name, 1.0)])
        return Column(
            f"{name} {function.name}", unit + function.per, prior_sd / function.largest, terms
        )

    shifts = [column(n, "mm", TYPICAL_MM) for n in SHIFTS]
    return [*shifts, *(column(n, "rad", TYPICAL_RAD) for n in TURNS)]


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    if facts.timed:
        yield from make_drifts(facts, "mount_drift", location.BASE, _along)
    yield from make_steps(facts, "mount_drift", location.BASE, _columns)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    if is_drift(candidate):
        shift, turn = (
            float(np.linalg.norm([compute_swing(candidate, amplitudes, name) for name in names]))
            for names in (SHIFTS, TURNS)
        )
        return (
            f"the base {describe_course(candidate)}, by up to {format_plain(shift * 1e3)} µm and "
            f"{seconds_of_arc(turn)} in the time seen"
        )
    shift = float(np.linalg.norm(amplitudes[:3])) * 1e3
    turn = float(np.linalg.norm(amplitudes[3:])) / ARC_SECOND
    size = f"{format_plain(shift)} µm and {format_plain(turn)}″"
    return f"the base stepped by {size}{describe_instant(candidate)}"


EFFECT = Effect(
    "mount_drift",
    "clamp, table or magnet creeps, or was knocked",
    "a slip of joint 1; lag",
    "measure one seat at the start and the end of every placement",
    list_candidates,
    describe,
    "the time of each reading (time_s)",
    accident=True,
    by_motion=True,
)

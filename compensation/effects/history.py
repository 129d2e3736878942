"""Unnamed effects that depend on the history before a reading: a joint's way, or its use.

A joint that follows its drive through a spring, and slips when the spring yields, is wound up by
the way since it turned back. Over short ways its angle is too large in proportion; after each
longer way it has a new zero. Without a function of its own, a gain and a drifting zero were found
instead, both with high probability. A link may also be warmed by the use of a joint other than its
own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from armd.compensation.effects import location
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    SessionFacts,
    Use,
    Winding,
    list_lengths,
)
from armd.compensation.effects.thermal.self_heating import FINER, TYPICAL_STRAIN

#: Ways after which a joint slips. The shortest resembles backlash, the longest, which is more than
#: a joint moves, a gain. They increase by factors of two; several together refine one.
WITHIN_RAD = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
FINER_SPRINGS = ((0.7,), (0.84,), (1.19,), (1.4,), (0.5, 1.0, 2.0))
TYPICAL_RAD = 10e-6
TIME_CONSTANTS_S = (120.0, 480.0, 1920.0)


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    if not facts.timed:
        return
    for joint in facts.joints:
        for within in WITHIN_RAD:
            yield _wound(joint, (within,), facts.rates)
    for link in facts.joints:
        pairs = tuple(list_lengths(facts, link))
        for joint in facts.joints:
            if joint == link or not pairs:
                continue
            for by_rate in (True, False) if facts.rates else (False,):
                for lag_s in TIME_CONSTANTS_S:
                    yield _used(link, joint, by_rate, lag_s, pairs)


def _wound(joint: int, within_rad: Sequence[float], rates: bool, finest: bool = False) -> Candidate:
    parameter = f"theta_{joint}"
    columns = tuple(
        Column(
            f"{parameter} × wound within {within:.3g} rad",
            "rad",
            TYPICAL_RAD,
            use=Winding(joint, within, ((parameter, 1.0),)),
        )
        for within in within_rad
    )

    def refine() -> list[Candidate]:
        """Return candidates with another spring, or with several that slip one after the other."""
        return [
            _wound(joint, [f * within_rad[0] for f in factors], rates, True)
            for factors in FINER_SPRINGS
        ]

    variables = (*([f"w{joint}"] if rates else []), f"q{joint}", "time_s")
    place = location.parameter(joint, f"{parameter}({', '.join(variables)}, way before)")
    return Candidate("unknown", place, columns, variables, refine=None if finest else refine)


def _used(
    link: int,
    joint: int,
    by_rate: bool,
    lag_s: float,
    pairs: tuple[tuple[str, float], ...],
    finest: bool = False,
) -> Candidate:
    by = "rate" if by_rate else "way"
    column = Column(
        f"length {link} × use of joint {joint} by {by}, {lag_s:.0f} s",
        "1 per rad/s",
        TYPICAL_STRAIN,
        use=Use(joint, by_rate, lag_s, pairs),
    )
    variables = (f"w{joint}" if by_rate else f"q{joint}", "time_s")
    place = location.parameter(link, f"length_{link}({', '.join(variables)}, use)")

    def refine() -> list[Candidate]:
        return [_used(link, joint, by_rate, lag_s * factor, pairs, True) for factor in FINER]

    return Candidate("unknown", place, (column,), variables, refine=None if finest else refine)

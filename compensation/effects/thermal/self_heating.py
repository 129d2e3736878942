"""A joint warms by its own use, and no sensor measures it.

The heat comes from the rates at the readings, or from the ways between readings. Both are known
only at readings, so no calibration can contain this; it is only reported.
"""

from collections.abc import Iterator

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    Effect,
    SessionFacts,
    Use,
    list_lengths,
)
from armd.compensation.wording import ARC_SECOND, format_plain, seconds_of_arc

TIME_CONSTANTS_S = (60.0, 120.0, 240.0, 480.0, 960.0, 1920.0)
FINER = (0.7, 0.84, 1.19, 1.4)
#: Typical final sizes at one radian a second.
TYPICAL_RAD, TYPICAL_STRAIN = 15 * ARC_SECOND, 60e-6


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    if not facts.timed:
        return
    for k in facts.joints:
        for by_rate in (True, False) if facts.rates else (False,):
            for lag_s in TIME_CONSTANTS_S:
                yield _warmed(k, by_rate, lag_s, "angle", ((f"theta_{k}", 1.0),))
                if pairs := list_lengths(facts, k):
                    yield _warmed(k, by_rate, lag_s, "length", tuple(pairs))


def _warmed(
    joint: int,
    by_rate: bool,
    lag_s: float,
    quantity: str,
    parameters: tuple[tuple[str, float], ...],
    finest: bool = False,
) -> Candidate:
    use = Use(joint, by_rate, lag_s, parameters)
    unit, prior_sd = ("rad", TYPICAL_RAD) if quantity == "angle" else ("1", TYPICAL_STRAIN)
    by = "rate" if by_rate else "way"
    column = Column(f"{quantity} by {by}", f"{unit} per rad/s", prior_sd, use=use)

    def rebuild(value: float) -> Candidate:
        return _warmed(joint, by_rate, value, quantity, parameters, True)

    return Candidate(
        "self_heating",
        location.joint(joint),
        (column,),
        (f"{'w' if by_rate else 'q'}{joint}", "time_s"),
        (("time constant", lag_s, "s"),),
        refine=None if finest else lambda: [rebuild(lag_s * factor) for factor in FINER],
        elsewhere=rebuild,
    )


def describe(candidate: Candidate, amplitudes: F64) -> str:
    size = float(amplitudes[0])
    if candidate.columns[0].name.startswith("angle"):
        description = f"the angle of {candidate.location} moves by {seconds_of_arc(size)}"
    else:
        description = (
            f"the link of {candidate.location} grows by {format_plain(1e6 * size, sign='+')} ppm"
        )
    return (
        f"{description} when it turns at 1 rad/s for long, with a time constant of "
        f"{candidate.setting[0][1]:.0f} s; no calibration can hold this"
    )


EFFECT = Effect(
    "self_heating",
    "friction warms a much used bearing or brake far from every sensor",
    "a drift, an angle that is late where one session was fast",
    "turn the joint fast for ten minutes, then measure one seat again and again",
    list_candidates,
    describe,
    "times of all readings, and use that varies from one part of them to another",
)

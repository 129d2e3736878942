"""The encoder's disc moves off centre, or out of round, with temperature."""

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    Effect,
    SessionFacts,
    make_temperature,
    tie,
)
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.wording import ARC_SECOND, seconds_of_arc

ORDERS = (1, 2)
TYPICAL_RAD = 1.0 * ARC_SECOND  # per kelvin


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        weights = facts.weights(k)
        if not weights:
            continue
        for order in ORDERS:
            columns = tuple(
                Column(
                    f"{kind} per kelvin",
                    "rad/K",
                    TYPICAL_RAD,
                    tie(
                        [(f"theta_{k}", 1.0)],
                        make_temperature(weights),
                        Harmonic(kind=kind, joint=k, order=order),
                    ),
                )
                for kind in ("sin", "cos")
            )
            depends = (f"q{k}", *weights)
            setting = (("order", float(order), "1/turn"),)
            yield Candidate("encoder_thermal", location.joint(k), columns, depends, setting)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    times = "once" if candidate.setting[0][1] == 1.0 else "twice"
    return (
        f"the encoder disc of {candidate.location} errs {times} a turn by "
        f"{seconds_of_arc(float(np.hypot(*amplitudes)))} more with every kelvin"
    )


EFFECT = Effect(
    "encoder_thermal",
    "glue or hub of the disc expands unevenly: its error grows with temperature",
    "eccentricity, where all was measured at one temperature",
    "turn the joint through its whole range at one seat, cold and warm",
    list_candidates,
    describe,
    "temperatures of the joint that vary over the readings",
    as_coarse_as_the_arm=True,
    by_temperature=True,
)

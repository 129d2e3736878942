"""The encoder's disc is not round, or its axis moves twice a turn."""

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Effect, SessionFacts
from armd.compensation.effects.encoder.encoder_eccentricity import make_harmonic_columns
from armd.compensation.wording import ARC_SECOND, seconds_of_arc


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        columns = make_harmonic_columns(k, 2, 3 * ARC_SECOND)
        yield Candidate("encoder_ellipticity", location.joint(k), columns, (f"q{k}",))


def describe(candidate: Candidate, amplitudes: F64) -> str:
    angle = float(np.hypot(*amplitudes))
    return f"the angle of {candidate.location} is wrong by {seconds_of_arc(angle)} twice a turn"


EFFECT = Effect(
    "encoder_ellipticity",
    "an oval disc, or two heads not quite opposite, show the angle wrong twice a turn",
    "eccentricity on a joint of short range",
    "turn the joint through its whole range at one seat",
    list_candidates,
    describe,
    as_coarse_as_the_arm=True,
)

"""A stable error of the angle, of a higher order: interpolation, gear teeth, a graduation."""

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Effect, SessionFacts
from armd.compensation.effects.encoder.encoder_eccentricity import make_harmonic_columns
from armd.compensation.wording import ARC_SECOND, seconds_of_arc

ORDERS = range(3, 41)
#: A curve over the turn is a group of all orders up to one of these.
CURVES = (8, 20, 40)
UNDECIDED = "whether encoder or gear causes it these data cannot tell"


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        for order in ORDERS:
            columns = make_harmonic_columns(k, order, 2 * ARC_SECOND)
            setting = (("order", float(order), "1/turn"),)
            yield Candidate("encoder_periodic", location.joint(k), columns, (f"q{k}",), setting)
        for highest in CURVES:
            group = tuple(
                column
                for order in range(3, highest + 1)
                for column in make_harmonic_columns(k, order, 2 * ARC_SECOND)
            )
            setting = (("highest order", float(highest), "1/turn"),)
            yield Candidate("encoder_periodic", location.joint(k), group, (f"q{k}",), setting)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    return (
        f"the angle of {candidate.location} is wrong by "
        f"{seconds_of_arc(float(np.hypot(*amplitudes[:2])))} {candidate.setting[0][1]:.0f} times "
        f"a turn; {UNDECIDED}"
    )


def describe_curve(candidate: Candidate, rms_rad: float, order: int) -> str:
    """Describe a curve over the turn."""
    return (
        f"the angle of {candidate.location} is wrong by {seconds_of_arc(rms_rad)} (root mean "
        f"square over the angles at which it stood) along a stable curve, most of it near {order} "
        f"periods a turn; {UNDECIDED}"
    )


EFFECT = Effect(
    "encoder_periodic",
    "graduation, interpolation or gear teeth repeat along the turn",
    "eccentricity of a neighbour when poses are few",
    "measure one seat at small steps of this joint, several per shortest period",
    list_candidates,
    describe,
    as_coarse_as_the_arm=True,
    describe_curve=describe_curve,
)

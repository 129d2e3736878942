"""A gear between two joints: the angle of one errs as the other turns."""

from collections.abc import Iterator
from itertools import permutations

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts, tie
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.model.terms import Factor, Term
from armd.compensation.wording import ARC_SECOND, seconds_of_arc

#: Waves a turn: a wheel's run-out, or its teeth if they are few.
ORDERS = range(1, 21)
#: Arms whose encoders are on their axes have no gear between joints. An axis that wobbles once or
#: twice a turn has the same effect on a parallel axis beside it.
RARE = 0.1
TYPICAL_RAD = 3 * ARC_SECOND


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for joint, other_joint in permutations(facts.joints, 2):
        for own_turns in (0, 1, -1) if abs(joint - other_joint) == 1 else (0,):
            for order in ORDERS:
                yield _mesh(joint, other_joint, own_turns, order)


def _mesh(joint: int, other_joint: int, own_turns: int, order: int) -> Candidate:
    """Make a candidate; *own_turns* is the factor of the joint's own turn.

    It is 0, or ±1 in a differential.
    """
    rolled = f"q{other_joint}" + {0: "", 1: f" + q{joint}", -1: f" - q{joint}"}[own_turns]

    def wave(kind: str, wave_joint: int) -> Factor:
        return Harmonic.model_validate({"kind": kind, "joint": wave_joint, "order": order})

    def sum_of(*products: tuple[float, str, str]) -> tuple[Term, ...]:
        """Return terms for products of the other joint's wave and the joint's own."""
        if own_turns == 0:
            return tie([(f"theta_{joint}", 1.0)], wave(products[0][1], other_joint))
        return tuple(
            term
            for sign, a, b in products
            for term in tie([(f"theta_{joint}", sign)], wave(a, other_joint), wave(b, joint))
        )

    columns = (
        Column(
            f"sin({rolled})",
            "rad",
            TYPICAL_RAD,
            sum_of((1, "sin", "cos"), (own_turns, "cos", "sin")),
        ),
        Column(
            f"cos({rolled})",
            "rad",
            TYPICAL_RAD,
            sum_of((1, "cos", "cos"), (-own_turns, "sin", "sin")),
        ),
    )
    depends = (f"q{other_joint}", f"q{joint}") if own_turns else (f"q{other_joint}",)
    setting = (("order", float(order), "1/turn"),)
    return Candidate("gear_mesh", location.joint(joint), columns, depends, setting)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    rolled = candidate.columns[0].name.removeprefix("sin")
    return (
        f"the angle of {candidate.location} errs by {seconds_of_arc(float(np.hypot(*amplitudes)))} "
        f"{candidate.setting[0][1]:.0f} times a turn of {rolled}"
    )


EFFECT = Effect(
    "gear_mesh",
    "a wheel or belt that joins two joints runs out: as one turns, the other is pushed",
    "wobble of the other joint's axis, a cable led over both",
    "hold one joint, turn the other through its range, at one seat",
    list_candidates,
    describe,
    as_coarse_as_the_arm=True,
    commonness=RARE,
)

"""The encoder's disc is not centred on its axis."""

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts, tie
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.wording import ARC_SECOND, format_plain, seconds_of_arc

DISC_DIAMETER_MM = 50.0  # of a typical arm's encoder, for the description only


def make_harmonic_columns(joint: int, order: int, prior_sd: float) -> tuple[Column, ...]:
    """Make columns that add sine and cosine of an order of a joint's angle to the angle."""
    return tuple(
        Column(
            kind,
            "rad",
            prior_sd,
            tie([(f"theta_{joint}", 1.0)], Harmonic(kind=kind, joint=joint, order=order)),
        )
        for kind in ("sin", "cos")
    )


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        yield Candidate(
            "encoder_eccentricity",
            location.joint(k),
            make_harmonic_columns(k, 1, 6 * ARC_SECOND),
            (f"q{k}",),
        )


def describe(candidate: Candidate, amplitudes: F64) -> str:
    angle = float(np.hypot(*amplitudes))
    offset_um = angle / ARC_SECOND * DISC_DIAMETER_MM / 412.0
    return (
        f"the encoder disc of {candidate.location} sits {format_plain(offset_um)} µm off centre "
        f"({seconds_of_arc(angle)} on a disc of {DISC_DIAMETER_MM:.0f} mm)"
    )


EFFECT = Effect(
    "encoder_eccentricity",
    "a disc off its axis shows the angle wrong by e/R · sin(θ − φ), once a turn",
    "wobble of the last axis, encoder scale or ellipticity on a joint of short range, "
    "compliance of joint 2",
    "turn the joint through its whole range at one seat, hold the others",
    list_candidates,
    describe,
    as_coarse_as_the_arm=True,
)

"""Effects planted into what the encoders said, whatever the readings come from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from typing import Literal

import numpy as np

from armd.arrays import F64
from armd.compensation.data.sessions.session import Session
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, tie
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.model.state import States

ARC_SECOND = np.pi / 180 / 3600

Effect = Callable[[States], F64]  # what it adds to the angles (n, N), rad


def planted(sessions: Sequence[Session], *effects: Effect) -> list[Session]:
    """The same sessions with the effects in their angles."""

    def one(session: Session) -> Session:
        q = reduce(lambda q, effect: q + effect(session.states), effects, session.states.q)
        return replace(session, states=replace(session.states, q=q))

    return [one(session) for session in sessions]


def of_joint(joint: int, angle: Callable[[States], F64]) -> Effect:
    """An effect on the angle of one joint (1…N), in arc seconds."""

    def effect(states: States) -> F64:
        change = np.zeros_like(states.q)
        change[:, joint - 1] = angle(states) * ARC_SECOND
        return change

    return effect


def slip(joint: int, size: float, at_unix_s: float) -> Effect:
    """The index of a joint slips at a moment."""
    return of_joint(joint, lambda states: size * (states.time_s > at_unix_s))


def wave(joint: int, size: float, order: int = 1, phase: float = 0.4) -> Effect:
    """Eccentricity, ellipticity … of a joint's encoder."""
    return of_joint(joint, lambda s: size * np.sin(order * s.q[:, joint - 1] - phase))


def middle_unix_s(sessions: Sequence[Session]) -> float:
    return float(np.median(np.concatenate([s.states.time_s for s in sessions])))


def rms_um(sessions: Sequence[Session], arm: Arm, calibration: Calibration) -> float:
    """3-D RMS under a calibration."""
    return float(np.sqrt((evaluate(sessions, arm, calibration).distance_um ** 2).mean()))


def eccentric(joint: int) -> Candidate:
    """The disc of a joint off its axis."""
    sine: tuple[Literal["sin", "cos"], ...] = ("sin", "cos")
    harmonics = [Harmonic(kind=kind, joint=joint, order=1) for kind in sine]
    columns = tuple(
        Column(str(i), "rad", 3e-5, tie([(f"theta_{joint}", 1.0)], harmonic))
        for i, harmonic in enumerate(harmonics)
    )
    return Candidate("encoder_eccentricity", location.joint(joint), columns, (f"q{joint}",))

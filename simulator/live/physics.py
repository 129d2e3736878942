"""The arm in time: the operator's motion, heat, and the input of encoders and sensors.

Computed in blocks on the grid of the latches, so that a device only has to wait for its deadlines.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from math import sin, tau
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armd.arrays import F64
from armd.simulator.live.operator import Hand
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.effects.effect import Conditions
from armd.simulator.truth.heat import CAPACITY, TO_AIR, HeatField
from armd.simulator.truth.nominal import SELF_HEATING_W, list_parts

STEP_S = 0.05
STEPS = 10  # in a block: temperatures are sent twice a second
AIR_SWING_K, AIR_PERIOD_S = 0.2, 900.0  # the room's air conditioning


@dataclass(frozen=True)
class Block:
    """Some consecutive latches on the grid of the sample rate."""

    encoder_rad: F64  # (n, N) angles of ideal encoders, not wrapped
    tip_mm: F64  # (n, 3) the truth: the tip's centre in the base frame
    buttons: npt.NDArray[np.uint8]  # (n,)
    sensor_c: F64  # (STEPS, S) temperatures of the sensors

    def felt_c(self, row: int) -> F64:
        """Return the sensors' temperatures (S,) at latch *row* of the block."""
        felt: F64 = self.sensor_c[row * len(self.sensor_c) // len(self.buttons)]
        return felt


@dataclass(frozen=True)
class WarmUp:
    """An arm that warms by *rise_k* (mean of its links) within *duration_s*, faster than real.

    One factor shortens all time constants, the sensors' lags like the links': a warm-up of two
    hours in less time, with the same gradients.
    """

    rise_k: float
    duration_s: float


class Heat:
    """The heat field with the room's air and the arm's own electronics."""

    def __init__(self, ambient_c: float, warm_up: WarmUp | None, joints: int) -> None:
        self._field = HeatField(ambient_c, joints=joints)
        self._ambient_c = ambient_c
        self._power: F64 = SELF_HEATING_W[list_parts(joints)]
        self._haste = 1.0
        if warm_up is not None:
            rise = self._field.steady_c(ambient_c, self._power) - ambient_c
            self._power *= warm_up.rise_k / float(rise.mean())
            # Three of the slowest link's time constants within the given time.
            self._haste = 3.0 * float((CAPACITY / TO_AIR).max()) / warm_up.duration_s
        self._time_s = 0.0

    def advance_to(self, time_s: float) -> tuple[F64, F64]:
        """Return link (N,) and sensor (S,) temperatures, °C; ask in order of time."""
        self._field.step((time_s - self._time_s) * self._haste, self.air_c, self._power)
        self._time_s = time_s
        return self._field.link_c, self._field.sensor_c

    @property
    def air_c(self) -> float:
        return self._ambient_c + AIR_SWING_K * sin(tau * self._time_s / AIR_PERIOD_S)


class Step(NamedTuple):
    """Some latches with constant temperatures: motion of the hand and state of the room."""

    phi: F64  # (n, N) axis angles, rad
    rate: F64  # (n, N) rad/s
    buttons: npt.NDArray[np.uint8]  # (n,)
    time_s: F64  # (n,)
    link_c: F64  # (n, N)
    air_c: F64  # (n,)
    sensor_c: F64  # (1, S)


def generate_blocks(
    arm: TrueArm, hand: Hand, rate_hz: int, ambient_c: float, warm_up: WarmUp | None
) -> Iterator[Block]:
    """Generate the arm's course from time 0 on, sample k at k / rate_hz; never ends."""
    life = generate_steps(hand, Heat(ambient_c, warm_up, arm.n_joints), rate_hz)
    while True:
        next_steps = zip(*itertools.islice(life, STEPS), strict=True)
        together = Step(*(np.concatenate(parts) for parts in next_steps))
        conditions = Conditions(
            link_c=together.link_c,
            rate=together.rate,
            time_s=together.time_s,
            approach=np.tile([0.0, 0.0, -1.0], (len(together.time_s), 1)),
            ambient_c=together.air_c,
        )
        yield Block(
            arm.encoder_angles(together.phi, conditions),
            arm.tip(together.phi, conditions),
            together.buttons,
            together.sensor_c,
        )


def group_in_blocks(life: Iterator[tuple[Step, F64]]) -> Iterator[Block]:
    """Group steps and true tips (n, 3) mm in blocks, for an arm whose encoders are ideal."""
    while True:
        next_steps, tips = zip(*itertools.islice(life, STEPS), strict=True)
        yield Block(
            np.concatenate([step.phi for step in next_steps]),
            np.concatenate(tips),
            np.concatenate([step.buttons for step in next_steps]),
            np.concatenate([step.sensor_c for step in next_steps]),
        )


def generate_steps(hand: Hand, heat: Heat, rate_hz: int) -> Iterator[Step]:
    """Generate the states of hand and room from time 0 on, `STEP_S` at a time; never ends."""
    n = max(1, round(STEP_S * rate_hz))
    for first in itertools.count(0, n):
        time_s = np.arange(first, first + n) / rate_hz
        link_c, sensor_c = heat.advance_to(float(time_s[0]))
        phi, rate, buttons = hand.angles(time_s, link_c)
        yield Step(
            phi,
            rate,
            buttons,
            time_s,
            np.tile(link_c, (n, 1)),
            np.full(n, heat.air_c),
            sensor_c[None, :].copy(),
        )

"""What happens to the arm in time: the operator's motion, heat, and what encoders and sensors feel.

Computed in blocks on the grid of the latches, so that a device only has to wait for its deadlines.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass
from math import sin, tau

import numpy as np
import numpy.typing as npt

from armd.simulator.operator import Operator
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.conditions import Conditions
from armd.simulator.truth.heat import CAPACITY, SELF_HEATING_W, TO_AIR, HeatField

F64 = npt.NDArray[np.float64]

BLOCK_S = 0.05
REST_S = BLOCK_S / 5
AIR_SWING_K, AIR_PERIOD_S = 0.2, 900.0  # the room's air conditioning


@dataclass(frozen=True)
class Block:
    """Some consecutive latches on the grid of the sample rate."""

    encoder_rad: F64  # (n, N) what ideal encoders show, not wrapped
    tip_mm: F64  # (n, 3) the truth: the tip's centre in the base frame
    buttons: npt.NDArray[np.uint8]  # (n,)
    sensor_c: F64  # (S,) what the sensors feel


@dataclass(frozen=True)
class WarmUp:
    """An arm that warms by *rise_k* (mean of its links) within *duration_s*, in fast motion.

    All time constants shrink by one factor, the sensors' lags with the links': a warm-up of two
    hours, hastened, with the same gradients.
    """

    rise_k: float
    duration_s: float


class Heat:
    """The heat field driven by the room's air and the arm's own electronics."""

    def __init__(self, ambient_c: float, warm_up: WarmUp | None) -> None:
        self._field = HeatField(ambient_c)
        self._ambient_c = ambient_c
        self._power: F64 = SELF_HEATING_W.copy()
        self._haste = 1.0
        if warm_up is not None:
            rise = self._field.steady_c(ambient_c, self._power) - ambient_c
            self._power *= warm_up.rise_k / float(rise.mean())
            # Three of the slowest link's time constants within the given time.
            self._haste = 3.0 * float((CAPACITY / TO_AIR).max()) / warm_up.duration_s
        self._time_s = 0.0

    def at(self, time_s: float) -> tuple[F64, F64]:
        """Link (N,) and sensor (S,) temperatures, °C; ask in order of time."""
        self._field.step((time_s - self._time_s) * self._haste, self.air_c, self._power)
        self._time_s = time_s
        return self._field.link_c, self._field.sensor_c

    @property
    def air_c(self) -> float:
        return self._ambient_c + AIR_SWING_K * sin(tau * self._time_s / AIR_PERIOD_S)


def blocks(
    arm: TrueArm, seed: int, rate_hz: int, ambient_c: float, warm_up: WarmUp | None
) -> Iterator[Block]:
    """The arm's life from time 0 on, sample k at k / rate_hz; never ends."""
    operator = Operator(arm, seed)
    heat = Heat(ambient_c, warm_up)
    n = max(1, round(BLOCK_S * rate_hz))
    first = 0
    while True:
        time_s = np.arange(first, first + n) / rate_hz
        link_c, sensor_c = heat.at(float(time_s[0]))
        phi, rate, buttons = operator.angles(time_s, link_c)
        conditions = Conditions(
            link_c=np.tile(link_c, (n, 1)),
            rate=rate,
            time_s=time_s,
            approach=np.tile([0.0, 0.0, -1.0], (n, 1)),
            ambient_c=np.full(n, heat.air_c),
        )
        yield Block(
            arm.encoder_angles(phi, conditions), arm.tip(phi, conditions), buttons, sensor_c
        )
        first += n


def unhurried(blocks: Iterator[Block]) -> Iterator[Block]:
    """With a rest after each: one who computes ahead of time keeps nobody from a processor."""
    for block in blocks:
        yield block
        time.sleep(REST_S)


def gathered(blocks: Iterator[Block], number: int) -> Iterator[Block]:
    """As many blocks at a time as one; the sensors feel what they did at its beginning."""
    while some := list(itertools.islice(blocks, number)):
        yield Block(
            np.concatenate([block.encoder_rad for block in some]),
            np.concatenate([block.tip_mm for block in some]),
            np.concatenate([block.buttons for block in some]),
            some[0].sensor_c,
        )

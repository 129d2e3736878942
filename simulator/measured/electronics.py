"""Electronics that restart during a measurement: a digital thermometer, an encoder's counter.

A thermometer that lost its supply for a moment holds its power-on value until the next conversion,
and a reading before that gets it. A single-turn encoder knows its angle after a restart, but not
the number of turns: it continues on another turn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64

#: Values at power-on, °C: DS18B20 (85 in its data sheet), a bridge that reads an open probe as
#: the lower end of its scale, a register of zeros, the largest of twelve bits.
POWER_ON_C = (85.0, -40.0, 0.0, 127.9375)


@dataclass(frozen=True)
class BrownOuts:
    """One thermometer that sometimes loses its supply, for less than the time between readings."""

    sensor: int
    power_on_c: float
    shares: dict[str, tuple[float, ...]]  # by session: as shares of its readings

    def read(self, session: str, sensor_c: F64) -> F64:
        """Return the values that the thermometers (n, S) °C of a session give."""
        reported_c = sensor_c.copy()
        for share in self.shares.get(session, ()):
            reported_c[int(share * len(reported_c)), self.sensor] = self.power_on_c
        return reported_c


@dataclass(frozen=True)
class Restarts:
    """One encoder that restarts in some sessions, before the first reading or between two."""

    joint: int
    since: dict[str, tuple[float, int]]  # by session: share of readings before, turns off

    def read(self, session: str, encoder: F64) -> F64:
        """Return the values that the encoders (n, N) rad of a session give."""
        reported = encoder.copy()
        share, turns = self.since.get(session, (1.0, 0))
        reported[int(share * len(reported)) :, self.joint] += math.tau * turns
        return reported


def draw_brown_outs(rng: np.random.Generator, sessions: list[str], sensors: int) -> BrownOuts:
    """Draw one to eight of them in each session that has any."""
    hit = [name for name in sessions if rng.uniform() < 0.4] or [str(rng.choice(sessions))]
    value = float(rng.choice(POWER_ON_C))
    shares = {name: tuple(rng.uniform(size=int(rng.integers(1, 9)))) for name in hit}
    return BrownOuts(int(rng.integers(sensors)), value, shares)


def draw_restarts(rng: np.random.Generator, sessions: list[str], joints: int) -> Restarts:
    """Draw a restart in about half of the sessions; in a third of these during the readings."""
    hit = [name for name in sessions if rng.uniform() < 0.5] or [str(rng.choice(sessions))]
    since = {
        name: (float(rng.uniform()) if rng.uniform() < 1 / 3 else 0.0, int(rng.choice([-1, 1])))
        for name in hit
    }
    return Restarts(int(rng.integers(joints)), since)

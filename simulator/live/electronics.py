"""Encoders and temperature sensors: convert true angles and temperatures to readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.arrays import F64
from armd.simulator.truth import nominal

ENCODER_NOISE_RAD = np.radians(0.5 / 3600)  # standard deviation of one latch
SENSOR_NOISE_C = 0.003
SENSOR_STEP_C = 0.01
COUNTS_PER_TURN = nominal.COUNTS_PER_TURN


@dataclass(frozen=True)
class ArmParts:
    """The encoders and sensors of an arm."""

    counts_per_turn: tuple[int, ...]  # (N,)
    direction: F64  # (N,) −1 where counts fall as the angle grows
    encoder_rad: float = ENCODER_NOISE_RAD  # noise, standard deviation of one latch
    sensor_c: float = SENSOR_NOISE_C

    @classmethod
    def for_demo_arm(cls, joints: int) -> ArmParts:
        return cls((COUNTS_PER_TURN,) * joints, np.ones(joints))

    @property
    def bits(self) -> tuple[int, ...]:
        """The number of bits of each encoder, whose counts wrap at 2^bits."""
        return tuple(turn.bit_length() - 1 for turn in self.counts_per_turn)


class Electronics:
    """Adds noise and quantises; the same noise for the same *seed*."""

    def __init__(self, seed: int, parts: ArmParts) -> None:
        self.parts = parts
        self._rng = np.random.default_rng([seed, 0xE1EC])
        self._turn = np.array(parts.counts_per_turn, dtype=np.int64)

    def counts(self, encoder_rad: F64) -> npt.NDArray[np.uint32]:
        """Convert angles (n, N) rad, not wrapped, to counts (n, N) that wrap at a turn."""
        noisy = encoder_rad + self._rng.normal(0.0, self.parts.encoder_rad, encoder_rad.shape)
        turns = self.parts.direction * noisy * (self._turn / (2 * np.pi))
        return (np.rint(turns).astype(np.int64) % self._turn).astype(np.uint32)

    def celsius(self, sensor_c: F64) -> F64:
        """Return temperatures (S,) as the sensors' converters give them."""
        noisy = sensor_c + self._rng.normal(0.0, self.parts.sensor_c, sensor_c.shape)
        read: F64 = np.rint(noisy / SENSOR_STEP_C) * SENSOR_STEP_C
        return read

"""Encoders and temperature sensors: what they make of the angles and temperatures they feel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armd.arrays import F64
from armd.simulator.truth import nominal

ENCODER_NOISE_RAD = np.radians(0.5 / 3600)  # standard deviation of one latch
SENSOR_NOISE_C = 0.003
SENSOR_STEP_C = 0.01
COUNTS_PER_TURN = nominal.COUNTS_PER_TURN
BITS = COUNTS_PER_TURN.bit_length() - 1


class Electronics:
    """Adds noise and quantises; the same noise for the same *seed*."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 0xE1EC])

    def counts(self, encoder_rad: F64) -> npt.NDArray[np.uint32]:
        """Angles (n, N) rad, not wrapped → counts (n, N) that wrap at 2^BITS."""
        noisy = encoder_rad + self._rng.normal(0.0, ENCODER_NOISE_RAD, encoder_rad.shape)
        counts = np.rint(noisy * (COUNTS_PER_TURN / (2 * np.pi))).astype(np.int64)
        return (counts % COUNTS_PER_TURN).astype(np.uint32)

    def celsius(self, sensor_c: F64) -> F64:
        """Temperatures (S,) as the sensors' converters give them."""
        noisy = sensor_c + self._rng.normal(0.0, SENSOR_NOISE_C, sensor_c.shape)
        read: F64 = np.rint(noisy / SENSOR_STEP_C) * SENSOR_STEP_C
        return read

"""The noise of readings, which is no effect: encoders, seating, sensors, a drifting stand."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.rotations import ARC_SECOND

#: Degrees of freedom of the heavy-tailed noise (Student's t), with infinite kurtosis.
HEAVY_TAILS = {"heavy": 4, "t3": 3}
#: Correlation time of the stand's drift, s.
WANDER_S = 1500.0


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the random errors of a reading (an average at rest)."""

    encoder_arcsec: float = 0.5
    seating_um: float = 0.5  # of the tip in its seat, each axis, at every reading
    sensor_c: float = 0.01
    tails: Literal["gaussian", "heavy", "t3"] = "gaussian"
    wander_um: float = 0.0  # of the stand, each axis, slowly
    correlation: float = 0.0  # of one reading's errors with the next one's
    sensor_step_c: float = 0.01  # resolution of temperatures on the wire

    def scaled(self, factor: float) -> Noise:
        """Return the noise times *factor*; without noise, sensors read true temperatures."""
        return replace(
            self,
            encoder_arcsec=factor * self.encoder_arcsec,
            seating_um=factor * self.seating_um,
            sensor_c=factor * self.sensor_c,
            wander_um=factor * self.wander_um,
        )

    def encoders(self, rng: np.random.Generator, shape: tuple[int, int]) -> F64:
        """Draw angle errors (n, N), rad."""
        return self.encoder_arcsec * ARC_SECOND * self._draw(rng, shape)

    def seating(self, rng: np.random.Generator, n: int) -> F64:
        """Draw displacements of the tip (n, 3), mm."""
        return 1e-3 * self.seating_um * self._draw(rng, (n, 3))

    def sensors(self, rng: np.random.Generator, celsius: F64) -> F64:
        """Return readings of the sensors (n, S): with noise, in the wire's steps."""
        read_c: F64 = celsius + rng.normal(0.0, self.sensor_c, celsius.shape)
        return (
            self.sensor_step_c * np.round(read_c / self.sensor_step_c) if self.sensor_c else read_c
        )

    def wander(self, rng: np.random.Generator, time_s: F64) -> F64:
        """Draw a slow displacement of the base (n, 3), mm: a first-order Gauss–Markov process."""
        steps = rng.normal(size=(len(time_s), 3))
        path = np.empty_like(steps)
        path[0] = steps[0]
        for i in range(1, len(time_s)):
            decay = np.exp(-(time_s[i] - time_s[i - 1]) / WANDER_S)
            path[i] = decay * path[i - 1] + np.sqrt(1 - decay**2) * steps[i]
        return 1e-3 * self.wander_um * path

    def _draw(self, rng: np.random.Generator, shape: tuple[int, int]) -> F64:
        """Draw values of unit variance, with a correlation of rows if one is set."""
        if self.tails == "gaussian":
            drawn = rng.normal(size=shape)
        else:
            freedom = HEAVY_TAILS[self.tails]
            drawn = rng.standard_t(freedom, shape) / np.sqrt(freedom / (freedom - 2))
        if self.correlation:
            fresh = np.sqrt(1.0 - self.correlation**2)
            for before, row in itertools.pairwise(drawn):
                row *= fresh
                row += self.correlation * before
        return drawn

"""The slow factors of a basis, of temperatures and time: one class for each kind.

Each class holds what a calibration file stores, the value at many readings, what it needs of an
instant, and the code by which the kernel knows it. The kernel folds it when a temperature arrives.
The compiled code of a kind is in `kernel.slow_factors`; a test compares it with the value here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from armd.arrays import F64
from armd.files.schema import Strict

if TYPE_CHECKING:
    from armd.compensation.model.instants import Instants

#: Seconds since 1970, UTC; up to the year 9999, the last that dates can express.
UnixSeconds = Annotated[float, Field(ge=0, le=253402300799)]
Weights = Annotated[dict[str, float], Field(min_length=1)]
DAY_S = 86400.0
#: Weights of the sensors and the lag in seconds of a mean temperature.
Mean = tuple[dict[str, float], float]


class SlowFactor(Strict):
    """A factor of temperatures or of time alone."""

    @property
    def means(self) -> list[Mean]:
        """The mean temperatures on which it depends."""
        return []

    def evaluate(self, instants: Instants) -> F64:
        """Evaluate the factor (n,) at each instant; a missing temperature or time gives NaN."""
        raise NotImplementedError

    def slow_code(self, means: Sequence[int], reference_c: float) -> tuple[str, int, int, F64]:
        """Return the factor's code for `kernel.slow_factors`.

        That is the kind there, two integers, and up to three numbers. *means* are the numbers of
        its mean temperatures.
        """
        raise NotImplementedError


class Temperature(SlowFactor):
    """(Σ weight·T_sensor − reference)^order, of the temperatures delayed by a first-order lag.

    `reference_c` None: the calibration's reference temperature. With `zone_c` = (low, high) in °C
    the factor is the paper's temperature zone, (clip(Σ weight·T, low, high) − low)^order, so that a
    sum over adjacent zones is a continuous piecewise polynomial; then the reference is not used.
    """

    kind: Literal["temperature"] = "temperature"
    weights: Weights
    order: Annotated[int, Field(ge=1, le=4)] = 1
    lag_s: Annotated[float, Field(ge=0)] = 0.0
    reference_c: float | None = None
    zone_c: tuple[float, float] | None = None

    @property
    def means(self) -> list[Mean]:
        return [(self.weights, self.lag_s)]

    def evaluate(self, instants: Instants) -> F64:
        value = instants.mean_c(self.weights, self.lag_s)
        if self.zone_c is not None:
            low, high = self.zone_c
            return (np.clip(value, low, high) - low) ** self.order
        reference = instants.reference_c if self.reference_c is None else self.reference_c
        return (value - reference) ** self.order

    def slow_code(self, means: Sequence[int], reference_c: float) -> tuple[str, int, int, F64]:
        if self.zone_c is not None:
            return "zone", means[0], self.order, np.array(self.zone_c)
        reference_c = reference_c if self.reference_c is None else self.reference_c
        return "power", means[0], self.order, np.array([reference_c])


class TemperatureRate(SlowFactor):
    """d/dt of Σ weight·T_sensor in K/s, smoothed by a first-order lag of `smoothing_s`."""

    kind: Literal["temperature_rate"] = "temperature_rate"
    weights: Weights
    smoothing_s: Annotated[float, Field(gt=0)] = 60.0

    @property
    def means(self) -> list[Mean]:
        return [(self.weights, 0.0), (self.weights, self.smoothing_s)]

    def evaluate(self, instants: Instants) -> F64:
        now, before = (instants.mean_c(*mean) for mean in self.means)
        return (now - before) / self.smoothing_s

    def slow_code(self, means: Sequence[int], reference_c: float) -> tuple[str, int, int, F64]:
        return "rate", means[0], means[1], np.array([self.smoothing_s])


class Dated(SlowFactor):
    """A factor of the date alone."""

    def evaluate(self, instants: Instants) -> F64:
        return self.evaluate_at_times(instants.time_s)

    def evaluate_at_times(self, time_s: F64) -> F64:
        """Evaluate the factor at times (n,) in Unix seconds."""
        raise NotImplementedError


class Period(Dated):
    """A factor of time with the period in which its term was identified.

    The period is `since_unix_s` to `until_unix_s`. Nobody knows how the term continues, so outside
    the period the factor keeps the value of the nearer end. None: no end yet (while the term is
    being identified; a loaded calibration always has one).
    """

    since_unix_s: UnixSeconds
    until_unix_s: UnixSeconds | None = None

    @model_validator(mode="after")
    def _in_order(self) -> Period:
        if self.until_unix_s is not None and self.until_unix_s < self.since_unix_s:
            raise ValueError(f"until_unix_s from {self.since_unix_s} on, not {self.until_unix_s}")
        return self

    @property
    def ends_unix_s(self) -> tuple[float, float]:
        """The beginning and the end; the end is infinite if there is none yet."""
        return self.since_unix_s, math.inf if self.until_unix_s is None else self.until_unix_s

    def _held_s(self, time_s: F64) -> F64:
        """Return the seconds since the beginning, limited to the period."""
        held_s: F64 = np.clip(time_s, *self.ends_unix_s)
        return held_s - self.since_unix_s


class Time(Period):
    """((t − since) / 3600 s)^power: hours since an instant (Unix seconds)."""

    kind: Literal["time"] = "time"
    power: Annotated[int, Field(ge=1, le=3)] = 1

    def evaluate_at_times(self, time_s: F64) -> F64:
        return (self._held_s(time_s) / 3600) ** self.power

    def slow_code(self, means: Sequence[int], reference_c: float) -> tuple[str, int, int, F64]:
        return "time", self.power, 0, np.array(self.ends_unix_s)


class Relaxation(Period):
    """1 − exp(−(t − since) / time constant)."""

    kind: Literal["relaxation"] = "relaxation"
    time_constant_s: Annotated[float, Field(gt=0)]

    def evaluate_at_times(self, time_s: F64) -> F64:
        return -np.expm1(-self._held_s(time_s) / self.time_constant_s)

    def slow_code(self, means: Sequence[int], reference_c: float) -> tuple[str, int, int, F64]:
        return "relaxation", 0, 0, np.array([*self.ends_unix_s, self.time_constant_s])


class Daily(Period):
    """sin or cos of the turn of the day since an instant."""

    kind: Literal["daily_sin", "daily_cos"]

    def evaluate_at_times(self, time_s: F64) -> F64:
        turn = math.tau * self._held_s(time_s) / DAY_S
        return np.sin(turn) if self.kind == "daily_sin" else np.cos(turn)

    def slow_code(self, means: Sequence[int], reference_c: float) -> tuple[str, int, int, F64]:
        return "day", int(self.kind == "daily_sin"), 0, np.array(self.ends_unix_s)


class After(Dated):
    """1 from an instant (Unix seconds) on, 0 before."""

    kind: Literal["after"] = "after"
    instant_unix_s: UnixSeconds

    def evaluate_at_times(self, time_s: F64) -> F64:
        return np.where(np.isfinite(time_s), time_s >= self.instant_unix_s, np.nan)

    def slow_code(self, means: Sequence[int], reference_c: float) -> tuple[str, int, int, F64]:
        return "after", 0, 0, np.array([self.instant_unix_s])


AnySlowFactor = Temperature | TemperatureRate | Time | Relaxation | Daily | After

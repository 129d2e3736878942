"""How far the temperatures can be trusted at an instant: held, stale, out of range, drifting."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd import Flag
from armd.compensation.arm import Arm
from armd.compensation.calibration import Calibration, used_sensors
from armd.daemon.config import Limits

F64 = npt.NDArray[np.float64]

STALE_AFTER_NS = 5_000_000_000
#: A rate of change is judged over this stretch, at first over at least the shorter one.
RATE_OVER_NS = 60_000_000_000
RATE_AFTER_NS = 3_000_000_000
#: More than this between two readings is a step, whatever the slope.
STEP_K = 0.2
NEVER_NS = np.iinfo(np.int64).max


@dataclass(frozen=True)
class Drift:
    """The fastest change among the sensors in use, in K/h, and its standard error."""

    sensor: str
    k_per_h: float
    standard_error: float
    jump_k_per_h: float  # the fastest step of more than STEP_K between two readings; else 0

    def __str__(self) -> str:
        return f"{self.sensor} drifts by {self.k_per_h:+.1f} K/h"

    def exceeds(self, limit_k_per_h: float) -> bool:
        """Beyond doubt: by a step, or by more than three standard errors."""
        return (
            self.jump_k_per_h > limit_k_per_h
            or abs(self.k_per_h) - 3 * self.standard_error > limit_k_per_h
        )


class TemperatureWatch:
    """Keeps the last good value of every channel and judges its age, range and rate."""

    def __init__(self, arm: Arm, limits: Limits) -> None:
        self.sensors = arm.sensors
        self._hold_ns = round(limits.temperature_hold_s * 1e9)
        self._limit_k_per_h = limits.temperature_rate_k_per_h
        self.held_c = np.full(len(self.sensors), arm.reference_temperature_c)
        self.current_c = np.full(len(self.sensors), np.nan)
        self._heard_c = self.current_c  # the last good value, NaN before the first
        self._good_ns = np.full(len(self.sensors), -1, np.int64)
        self._history: deque[tuple[int, F64]] = deque()
        self.use(arm, None)

    def use(self, arm: Arm, calibration: Calibration | None) -> None:
        """Judge by another calibration; what was measured so far stays."""
        used = used_sensors(arm, calibration)
        self._used = [i for i, name in enumerate(self.sensors) if name in used]
        ranges = {} if calibration is None else calibration.temperature_range_c
        self._low = np.array([ranges.get(name, (-np.inf, np.inf))[0] for name in self.sensors])
        self._high = np.array([ranges.get(name, (-np.inf, np.inf))[1] for name in self.sensors])
        own_limit = None if calibration is None else calibration.max_temperature_rate_k_per_h
        self._rate_limit = min(self._limit_k_per_h, own_limit or self._limit_k_per_h)
        self._judge()

    def begin(self, monotonic_ns: int) -> None:
        """The stream starts: from here on a temperature that was never heard ages."""
        self._good_ns[self._good_ns < 0] = monotonic_ns
        self._judge()

    def update(self, celsius: F64, monotonic_ns: int) -> None:
        """One reading of all channels (S,), NaN where invalid."""
        good = np.isfinite(celsius)
        self.current_c = celsius
        self.held_c = np.where(good, celsius, self.held_c)
        self._heard_c = np.where(good, celsius, self._heard_c)
        self._good_ns[good] = monotonic_ns
        self._history.append((monotonic_ns, self._heard_c))
        while self._history[0][0] < monotonic_ns - RATE_OVER_NS:
            self._history.popleft()
        self._judge()

    @property
    def heard(self) -> bool:
        """Any reading has come, be it of invalid channels."""
        return bool(self._history)

    def missing(self, monotonic_ns: int) -> list[str]:
        """Names of the sensors in use without a value at this instant."""
        late = self._good_ns + STALE_AFTER_NS < monotonic_ns
        return [self.sensors[i] for i in self._used if late[i] or np.isnan(self.current_c[i])]

    def outside(self) -> list[str]:
        """Names of the sensors in use beyond the identified range."""
        out = (self.held_c < self._low) | (self.held_c > self._high)
        return [self.sensors[i] for i in self._used if out[i]]

    def unsteady(self, limit_k_per_h: float) -> str:
        """Why the sensors in use are not called steady; "" if they are."""
        if not self._used:
            return ""
        if self.drift is None:
            return "temperatures are known for less than 3 s"
        return str(self.drift) if self.drift.exceeds(limit_k_per_h) else ""

    def as_json(self) -> dict[str, float | None]:
        """The last reading in °C by sensor name; None where a channel is invalid."""
        values = self.current_c.tolist()
        return {
            name: None if math.isnan(value) else round(value, 3)
            for name, value in zip(self.sensors, values, strict=True)
        }

    def _judge(self) -> None:
        self._judge_age()
        self.drift = self._fastest()
        self.slow_flags = Flag(0)
        if self.outside():
            self.slow_flags |= Flag.TEMPERATURE_RANGE
        if self.drift is not None and self.drift.exceeds(self._rate_limit):
            self.slow_flags |= Flag.TEMPERATURE_RATE

    def _judge_age(self) -> None:
        #: Samples later than this carry flag 2, …
        self.stale_after_ns = NEVER_NS
        #: … and later than this they are invalid: the temperature is held no longer.
        self.invalid_after_ns = NEVER_NS
        if self._used:
            oldest_ns = int(self._good_ns[self._used].min())
            self.invalid_after_ns = oldest_ns + self._hold_ns
            known = bool(np.isfinite(self.current_c[self._used]).all())
            self.stale_after_ns = oldest_ns + STALE_AFTER_NS if known else -1

    def _fastest(self) -> Drift | None:
        """Slopes by least squares over the history; None while it is too short to tell."""
        if not self._used or len(self._history) < 3:
            return None
        times = np.array([time for time, _ in self._history], np.float64)
        hours = (times - times[-1]) / 3.6e12
        if times[-1] - times[0] < RATE_AFTER_NS:
            return None
        heard = np.array([celsius for _, celsius in self._history])
        steady = [i for i in self._used if np.isfinite(heard[:, i]).all()]
        if not steady:
            return None
        values = heard[:, steady]
        centred = hours - hours.mean()
        spread = float(centred @ centred)
        slopes = centred @ values / spread
        residuals = values - values.mean(axis=0) - np.outer(centred, slopes)
        errors = np.sqrt((residuals**2).sum(axis=0) / (len(hours) - 2) / spread)
        steps = np.abs(np.diff(values, axis=0))
        within = np.maximum(np.diff(hours), 1e-12)[:, None]  # a reading told twice is no step
        jumps = (np.where(steps > STEP_K, steps, 0.0) / within).max(axis=0)
        worst = int(np.argmax(np.maximum(np.abs(slopes) - 3 * errors, jumps)))
        return Drift(
            self.sensors[steady[worst]],
            float(slopes[worst]),
            float(errors[worst]),
            float(jumps[worst]),
        )

"""Judge whether temperatures are too old, out of range or too fast; hold the last value."""

from __future__ import annotations

import math

import numpy as np

from armd import Flag
from armd.arrays import F64
from armd.compensation.data.soundness.heat_flow import LiveSensor
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration, list_used_sensors
from armd.daemon.config import Limits
from armd.daemon.live.temperature_rate import CoarseHistory, RecentReadings

STALE_AFTER_NS = 5_000_000_000
#: Readings a second that are used, and how many at once (modules that answer one after another).
#: Links take minutes, and each reading costs a fold and the slopes of a minute.
MOST_HZ, IN_A_ROW = 20.0, 8.0
NEVER_NS = np.iinfo(np.int64).max
STALE_NOW_NS = -1  # before every sample


class TemperatureWatch:
    """Stores the last good value of every channel and judges its age, range and rate."""

    def __init__(self, arm: Arm, limits: Limits) -> None:
        self.sensors = arm.sensors
        self._hold_ns = round(limits.temperature_hold_s * 1e9)
        self._limit_k_per_h = limits.temperature_rate_k_per_h
        n = len(self.sensors)
        #: (S,) the last good values, before the first arm.toml's reference; a new array each time
        self.held_c = np.full(n, arm.reference_temperature_c)
        # Plain lists: for a few sensors numpy takes ten times as long.
        self._current_c = [math.nan] * n
        self._heard_c = [math.nan] * n  # the last good value, NaN before the first
        self._good_ns = [-1] * n
        self._heat = [LiveSensor(arm.reference_temperature_c) for _ in self.sensors]
        #: °C by sensor name: the present reading that is impossible for a link, and the held value
        self.impossible: dict[str, tuple[float, float]] = {}
        self._begun_ns: int | None = None
        self._history: RecentReadings | CoarseHistory = RecentReadings(self.sensors)
        self._allowed, self._allowed_ns = IN_A_ROW, 0  # readings, at an instant
        self._resolution_c = 0.0
        self.use(arm, None)

    def use(self, arm: Arm, calibration: Calibration | None) -> None:
        """Judge by another calibration; the measured values stay."""
        used = list_used_sensors(arm, calibration)
        self._used = [i for i, name in enumerate(self.sensors) if name in used]
        self._used_array = np.array(self._used, np.int64)
        ranges = {} if calibration is None else calibration.temperature_range_c
        self._ranges = [
            (i, *ranges[name]) for i in self._used if (name := self.sensors[i]) in ranges
        ]
        own_limit = None if calibration is None else calibration.max_temperature_rate_k_per_h
        self._rate_limit = min(self._limit_k_per_h, own_limit or self._limit_k_per_h)
        self._judge()

    def begin(self, monotonic_ns: int) -> None:
        """Start the stream: from here on a temperature that was never received ages."""
        self._begun_ns = monotonic_ns
        self._good_ns = [monotonic_ns if good_ns < 0 else good_ns for good_ns in self._good_ns]
        self._judge()

    def update(self, celsius: F64, monotonic_ns: int, resolution_c: float = 0.0) -> bool:
        """Take one reading of all channels (S,), NaN where invalid.

        It has steps of *resolution_c*. Returns False and does nothing if too many readings come,
        unless a channel has become invalid now.
        """
        if resolution_c != self._resolution_c:
            self._resolution_c = resolution_c
            self._history = CoarseHistory(self.sensors, resolution_c)
        current_c = celsius.tolist()
        passed_s = max(0, monotonic_ns - self._allowed_ns) * 1e-9
        self._allowed = min(self._allowed + passed_s * MOST_HZ, IN_A_ROW)
        self._allowed_ns = max(monotonic_ns, self._allowed_ns)
        if self._allowed >= 1.0:
            self._allowed -= 1.0
        elif not any(
            math.isnan(new) and not math.isnan(old)
            for new, old in zip(current_c, self._current_c, strict=True)
        ):
            return False
        self._current_c = self._possible(current_c, monotonic_ns * 1e-9)
        self.held_c = self.held_c.copy()
        for i, value in enumerate(self._current_c):
            if math.isfinite(value):
                self.held_c[i] = self._heard_c[i] = value
                self._good_ns[i] = monotonic_ns
        self._history.append(self._heard_c, monotonic_ns)
        self._judge()
        return True

    def _possible(self, read_c: list[float], time_s: float) -> list[float]:
        """Return the values that are possible for a link.

        Others become NaN, as of an invalid channel.
        """
        possible_c = list(read_c)
        self.impossible = {}
        for i, value in enumerate(read_c):
            if math.isfinite(value) and not self._heat[i].believe(value, time_s):
                possible_c[i] = math.nan
                self.impossible[self.sensors[i]] = value, float(self.held_c[i])
        return possible_c

    @property
    def has_values(self) -> bool:
        """Whether every sensor in use has had a value."""
        return not any(math.isnan(self._heard_c[i]) for i in self._used)

    def stale_sensors(self, monotonic_ns: int) -> tuple[str, ...]:
        """Return the sensors in use that are invalid, or silent for 5 s, at this instant."""
        if monotonic_ns <= self.stale_after_ns:
            return ()
        late_ns = monotonic_ns - STALE_AFTER_NS
        return tuple(
            self.sensors[i]
            for i in self._used
            if self._good_ns[i] < late_ns or math.isnan(self._current_c[i])
        )

    def sensors_to_report(self, monotonic_ns: int) -> tuple[str, ...]:
        """Return the stale sensors, except those whose first value may still come.

        The first values are awaited for 5 s after the start.
        """
        waited = self._begun_ns is not None and monotonic_ns > self._begun_ns + STALE_AFTER_NS
        return tuple(
            name
            for name in self.stale_sensors(monotonic_ns)
            if waited or not math.isnan(self._heard_c[self.sensors.index(name)])
        )

    def unsteady(self, limit_k_per_h: float) -> str:
        """Return why the sensors in use are not steady; "" if they are."""
        if not self._used:
            return ""
        if self.drift is None:
            return "temperatures are known for less than 3 s"
        return str(self.drift) if self.drift.exceeds(limit_k_per_h) else ""

    def as_json(self) -> dict[str, float | None]:
        """Return the last reading in °C by sensor name; None for an invalid channel."""
        return {
            name: None if math.isnan(value) else round(value, 3)
            for name, value in zip(self.sensors, self._current_c, strict=True)
        }

    def _judge(self) -> None:
        self._judge_age()
        self.drift = self._history.fastest(self._used_array)
        held_c = self.held_c.tolist()
        #: names of the sensors in use beyond the identified range
        self.outside = tuple(
            self.sensors[i] for i, low, high in self._ranges if held_c[i] < low or held_c[i] > high
        )
        self.temperature_flags = Flag(0)
        if self.outside:
            self.temperature_flags |= Flag.TEMPERATURE_RANGE
        used = (self.sensors[i] for i in self._used)
        if (self.drift is not None and self.drift.exceeds(self._rate_limit)) or any(
            name in self.impossible for name in used
        ):
            self.temperature_flags |= Flag.TEMPERATURE_RATE

    def _judge_age(self) -> None:
        #: Samples later than this have `Flag.TEMPERATURE_STALE`.
        self.stale_after_ns = NEVER_NS
        #: Samples later than this are invalid: the temperature is too old to be held.
        self.invalid_after_ns = NEVER_NS
        if self._used:
            oldest_ns = min([self._good_ns[i] for i in self._used])
            self.invalid_after_ns = oldest_ns + self._hold_ns
            is_known = all(math.isfinite(self._current_c[i]) for i in self._used)
            self.stale_after_ns = oldest_ns + STALE_AFTER_NS if is_known else STALE_NOW_NS

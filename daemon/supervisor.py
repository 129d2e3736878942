"""Supervise one arm from second to second: its state, the reason, and its health."""

from __future__ import annotations

import datetime
import time
from dataclasses import asdict
from typing import Any

from armd.daemon.config import Config
from armd.daemon.health import Second, Tally
from armd.daemon.host.root import is_root
from armd.daemon.interim_checks import InterimChecks, explain_complaints
from armd.daemon.live.arm_in_use import ArmInUse
from armd.daemon.live.end_stops import EndStopWatch
from armd.daemon.live.pipeline import PointArray
from armd.daemon.state import Observation, State, judge_state
from armd.daemon.unexpected import Unexpected
from armd.drivers.sample import Driver, Event, SampleArray

SECOND_NS = 1_000_000_000
#: Share of a second's points; fewer losses are flagged and counted, but do not change the state.
LOSSY = 0.01
#: Time with values after which a sensor counts as back, so that flicker is ignored.
BACK_AFTER_NS = 500_000_000


class Supervisor:
    """The supervisor, which gets every batch and every event, and knows the state."""

    def __init__(
        self, config: Config, driver: Driver, arm: ArmInUse, now_ns: int, unexpected: Unexpected
    ) -> None:
        self._config = config
        self._driver = driver
        self._arm = arm
        self._unexpected = unexpected
        self._started_ns = now_ns
        self._replays = config.driver.kind == "replay"  # stamps are the recording's
        self._came_ns: int | None = None  # arrival of the last sample, not its latch
        self._trouble = ""
        self._tally = Tally(now_ns)
        self._second = Second()
        self._next_second_ns = now_ns + SECOND_NS
        self._stale: tuple[str, ...] = ()  # sensors that are invalid or silent
        self._reported: dict[str, int] = {}  # those with an event, and when seen last
        self._stops = EndStopWatch(config.arm)
        self._changed = self._interim_due = ""  # from the history of interim checks
        self.interim: InterimChecks | None = None
        if (interim := config.file.interim) is not None:
            self.interim = InterimChecks(
                config.resolve_path(interim.history), config.arm.serial_number
            )
        self.state = State.NOT_READY
        self.reason = "starting"

    def note_points(self, points: PointArray, samples: SampleArray, published_ns: int) -> None:
        self._tally.add(points, samples, published_ns)
        self._came_ns = published_ns
        self._trouble = ""

    def note_event(self, event: Event) -> None:
        """Store the text of a driver's warning or error, to explain a silence that may follow."""
        if event.severity != "info":
            self._trouble = event.text

    @property
    def rate_hz(self) -> float:
        """The points per second during the last second."""
        return self._second.rate_hz

    def assess(self, now_ns: int) -> list[Event]:
        """Update state and reason, and return the changes as events."""
        before = self.state
        self._tally.count()
        events = [*self._hear_interim(now_ns), *self._hear_sensors(now_ns)]
        events += self._stops.look(self._arm.pipeline.take_beyond_stops(), now_ns)
        self.state, self.reason = judge_state(self._observe(now_ns))
        if self.state is not before:
            severity = "info" if self.state in (State.READY, State.WARMING) else "warning"
            events.append(Event("state", f"{self.state}: {self.reason}", now_ns, severity))
        return events

    def _hear_sensors(self, now_ns: int) -> list[Event]:
        """Return events of sensors that lost their value, or have one again."""
        temperature = self._arm.pipeline.temperature
        stale = temperature.stale_sensors(self._tally.latched_ns)
        to_report = temperature.sensors_to_report(self._tally.latched_ns)
        if not (to_report or self._reported):
            self._stale = stale
            return []
        reported_before = {*self._reported}
        self._reported = {
            sensor: seen_ns
            for sensor, seen_ns in {**self._reported, **dict.fromkeys(to_report, now_ns)}.items()
            if now_ns - seen_ns < BACK_AFTER_NS
        }
        self._stale = tuple({**dict.fromkeys(stale), **self._reported})
        events = []
        for sensor in sorted(reported_before ^ {*self._reported}):
            if sensor in self._reported:
                text = f"sensor {sensor} is invalid or silent; its last value is held"
                if sensor in temperature.impossible:
                    read_c, held_c = temperature.impossible[sensor]
                    text = (
                        f"sensor {sensor} reads {read_c:g} °C: no link comes from {held_c:.1f} °C"
                        " to that so fast; its last value is held"
                    )
                kind, severity = "temperature_missing", "warning"
            else:
                text, kind, severity = f"sensor {sensor} is back", "temperature_back", "info"
            events.append(Event(kind, text, now_ns, severity, {"sensor": sensor}))
        return events

    def _hear_interim(self, now_ns: int) -> list[Event]:
        """Read the result of the interim checks, and return changes as events."""
        config = self._config.file.interim
        if self.interim is None or config is None or self._replays:
            return []
        before = (self._changed, self._interim_due)
        calibration = self._arm.calibration
        in_use = {} if calibration is None else calibration.content.provenance
        complaints = explain_complaints(self.interim.last, in_use, time.time(), config.at_most_h)
        self._changed, self._interim_due = complaints
        events = []
        for kind, was, now in zip(
            ("interim_changed", "interim_due"), before, complaints, strict=True
        ):
            if bool(was) != bool(now):
                severity = "warning" if now else "info"
                text = now or f"no longer: {was}"
                events.append(Event(kind, text, now_ns, severity))
        return events

    def _interim_health(self) -> dict[str, Any] | None:
        """Return the last interim check for the health key; None without a history."""
        if self.interim is None:
            return None
        last = self.interim.last
        if last is None or last.fault:
            return {"check": None, "age_h": None, "state": None, "reason": last and last.fault}
        return {
            "check": last.name,
            "age_h": round((time.time() - last.started_unix_s) / 3600.0, 2),
            "state": "changed" if last.changed else "in_control",
            "reason": self._changed or self._interim_due,
        }

    def close_second(self, now_ns: int) -> bool:
        """Sum up the second if it is over; return whether it is."""
        if now_ns < self._next_second_ns:
            return False
        self._next_second_ns += SECOND_NS
        self._second = self._tally.close_second(now_ns)
        return True

    def health(self, now_ns: int) -> dict[str, Any]:
        """Return the content of the health key."""
        second = self._second
        temperature = self._arm.pipeline.temperature
        drift = temperature.drift
        calibration = self._arm.calibration
        return {
            "serial": self._config.arm.serial_number,
            "stamp_ns": time.time_ns(),
            "state": self.state,
            "reason": self.reason,
            "uptime_s": round((now_ns - self._started_ns) * 1e-9, 1),
            "connected": self._driver.connected,
            "source": "replay" if self._replays else "live",
            "silent_s": self._silent_s(now_ns),
            "rates": {"points_hz": round(second.rate_hz, 1)},
            "points": {"published": self._tally.published, "flagged": dict(self._tally.flagged)},
            "last_second": {"points": second.points, "flagged": second.flagged},
            "drops": self._driver.counters,
            "temperatures": temperature.as_json(),
            "drift": None if drift is None else asdict(drift),
            "latency": second.latency_ms,
            "calibration": None if calibration is None else calibration.sha256[:16],
            "tip": self._arm.tip,
            "as_root": is_root(),
            "unexpected": self._unexpected.as_json(),
            "interim": self._interim_health(),
        }

    def _silent_s(self, now_ns: int) -> float | None:
        return None if self._came_ns is None else round((now_ns - self._came_ns) * 1e-9, 3)

    def _observe(self, now_ns: int) -> Observation:
        second = self._second
        temperature = self._arm.pipeline.temperature
        lossy = second.flagged.get("SAMPLES_LOST", 0) > LOSSY * second.points
        return Observation(
            silent_s=self._silent_s(now_ns),
            trouble=self._trouble,
            hindrance=self._driver.hindrance or self._stops.hindrance,
            points=second.points,
            flags=second.flags,
            invalid=second.invalid,
            lossy=lossy,
            invalid_joints=second.invalid_joints,
            warning_joints=second.warning_joints,
            missing_sensors=self._stale,
            outside_sensors=temperature.outside,
            late_s=0.0 if self._replays else second.latency_ms.get("p50", 0.0) * 1e-3,
            changed=self._changed,
            interim_due=self._interim_due,
            held_period=_format_period(self._arm.pipeline.outside_period),
            drift=temperature.unsteady(self._config.file.health.steady_k_per_h),
        )


def _format_period(unix_s: tuple[float, float] | None) -> str:
    """Format a period: `from 2026-03-01 09:00 to 2026-03-01 17:30 UTC`; "" for None."""
    if unix_s is None:
        return ""
    since, until = (datetime.datetime.fromtimestamp(time_s, datetime.UTC) for time_s in unix_s)
    return f"from {since:%Y-%m-%d %H:%M} to {until:%Y-%m-%d %H:%M} UTC"

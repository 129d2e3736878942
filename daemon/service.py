"""The daemon: one arm, one thread, from bytes to points.

It reads, corrects, flags and publishes. Everything else (queries, health, the watchdog) happens on
a tick between two reads.
"""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from typing import Any

import zenoh

from armd import keys
from armd.daemon.config import Config
from armd.daemon.event_groups import EventGroups
from armd.daemon.files.kept_tips import parse_tip
from armd.daemon.files.measurement_log import MeasurementLog, locate_log_folder
from armd.daemon.host import root
from armd.daemon.host.awake import Awake
from armd.daemon.host.journal import Journal
from armd.daemon.host.priority import raise_sender_priority
from armd.daemon.host.systemd import Systemd
from armd.daemon.info import describe, get_calibration_text
from armd.daemon.live.answer import Respond
from armd.daemon.live.arm_in_use import ArmInUse
from armd.daemon.live.changes import Changes
from armd.daemon.live.measurement import Averager, Press, TriggeredBy, as_list_if_finite
from armd.daemon.live.pipeline import Joints, PointArray
from armd.daemon.network.publisher import Publisher
from armd.daemon.network.queries import Queries
from armd.daemon.network.rival import RivalWatch
from armd.daemon.supervisor import Supervisor
from armd.daemon.unexpected import Unexpected
from armd.drivers.sample import Driver, Event, SampleArray, Temperatures
from armd.errors import ArmdError

READ_S = 0.05
#: Above this rate samples are gathered for a moment: waking up costs more than a sample, and ten
#: together cost a fifth of ten single ones.
FAST_HZ = 2000.0
GATHER_S = 0.002
TICK_NS = 50_000_000
#: Pause before a tick, about as long as a tick. A tick directly after a sample delayed sending its
#: point: one in fifty came 0.2 ms later, which was the live path's p99. Values from 0.15 to 0.3 ms
#: are equivalent; with 0.6 ms the next sample waits, at 1 kHz.
SENDING_S = 0.00025


class ForeignArm(ArmdError):
    """The error for another arm than arm.toml's, where the configuration says to stop then."""


class Service:
    """The daemon's service, from construction to `close`.

    A signal handler may call `stop` and `ask_reload`.
    """

    def __init__(
        self, config: Config, driver: Driver, session: zenoh.Session, arm: ArmInUse
    ) -> None:
        self._config = config
        self._driver = driver
        self._arm = arm
        serial = config.arm.serial_number
        self._publisher = Publisher(session, serial)
        self._unexpected = unexpected = Unexpected()
        self._groups = EventGroups()
        self._changes = changes = Changes(arm, self._tell_now)
        self._queries = Queries(
            session,
            serial,
            self._publisher,
            {
                keys.INFO: lambda: json.dumps(describe(config, *arm.in_use)),
                keys.CALIBRATION: lambda: get_calibration_text(arm.in_use[0]),
            },
            driver.preamble,
            {
                "reload": lambda _, answer: changes.reload(answer),
                "tip": lambda parameters, answer: changes.select_tip(
                    parameters.get("name") or "", answer
                ),
                "keep_tip": self._keep_tip,
            }
            if config.file.commands.enabled
            else None,
            unexpected,
        )
        self._rival = RivalWatch(session, serial)
        self._averager = Averager(config.file.measurement.average_s, config.arm.n_joints)
        self._at_rests = config.file.measurement.trigger == "rest"
        self._log = Journal()
        # A replayed measurement was logged when it was measured.
        logged = config.file.measurement.log and config.driver.kind != "replay"
        self._measured = MeasurementLog(locate_log_folder(serial)) if logged else None
        self._systemd = Systemd()
        self._awake = Awake()
        now_ns = time.monotonic_ns()
        self._supervisor = Supervisor(config, driver, arm, now_ns, unexpected)
        self._publisher.put_health(self._supervisor.health(now_ns))  # "starting"
        if self._supervisor.interim is not None:
            self._supervisor.interim.start()
        self._next_tick_ns = now_ns
        self._sender_settled = False
        self._stopping = False
        self._reload_asked = False

    def stop(self) -> None:
        self._stopping = True

    def ask_reload(self) -> None:
        self._reload_asked = True

    def health(self) -> dict[str, Any]:
        """Return the last published health message."""
        return self._publisher.health

    def run(self) -> None:
        """Publish until `stop`; raises `ForeignArm` if the configuration says so."""
        self._systemd.ready()
        if root.is_root():
            self._tell_now("runs_as_root", root.WARNING, "warning")
        while not self._stopping:
            if self._supervisor.rate_hz > FAST_HZ:
                time.sleep(GATHER_S)
            for item in self._driver.read(READ_S):
                match item:
                    case Temperatures():
                        self._arm.pipeline.take_temperatures(item)
                    case Event():
                        self._pass_on(item)
                    case samples:
                        self._publish(samples)
            self._publisher.put_raw(self._driver.take_raw())
            now_ns = time.monotonic_ns()
            if now_ns >= self._next_tick_ns:
                self._next_tick_ns = now_ns + TICK_NS
                time.sleep(SENDING_S)
                self._tick(now_ns)

    def close(self) -> None:
        self._systemd.stopping()
        self._queries.close()
        self._awake.keep(False)
        if self._supervisor.interim is not None:
            self._supervisor.interim.close()
        self._systemd.close()
        self._publisher.close()
        if self._measured is not None:
            self._measured.close()
        self._log.close()

    # --- the stream ----------------------------------------------------------------------

    def _publish(self, samples: SampleArray) -> None:
        points, joints = self._arm.pipeline.correct(samples)
        self._publisher.put_points(points)
        self._publisher.put_joints(points, samples, joints)
        self._supervisor.note_points(points, samples, time.monotonic_ns())
        for press in self._averager.remember(points, joints.q):
            self._press(press, points, joints)
        if self._at_rests:
            for row in self._averager.find_rests(points):
                self._measure("rest", row, points, joints)

    def _press(self, press: Press, points: PointArray, joints: Joints) -> None:
        point = points[press.row]
        names = ", ".join(str(button) for button in press.buttons)
        detail = {"buttons": press.buttons, "seq": int(point["seq"])}
        at_ns = int(point["monotonic_ns"])
        self._tell(Event("button", f"button {names} pressed", at_ns, "info", detail))
        self._measure("button", press.row, points, joints)

    def _measure(self, trigger: TriggeredBy, row: int, points: PointArray, joints: Joints) -> None:
        still_since_ns = int(joints.still_since_ns[row])
        measurement = self._averager.average(trigger, points[row], still_since_ns)
        tip = self._arm.tip_in_use
        line = self._publisher.measurements.put(
            measurement.as_json()
            | {
                "rates_rad_s": as_list_if_finite(joints.rate[row]),
                "approach": as_list_if_finite(joints.approach[row]),
                "temperatures_c": self._arm.pipeline.temperature.as_json(),
                "tip": self._arm.tip,
                "tip_offset_mm": tip.offset_mm,
                "tip_radius_mm": tip.radius_mm,
                "serial": self._config.arm.serial_number,
            }
        )
        if self._measured is not None:
            self._measured.add(line)

    def _keep_tip(self, parameters: zenoh.Parameters, answer: Respond) -> None:
        try:
            words = [parameters.get(key) or "" for key in ("name", "offset_mm", "radius_mm")]
            name, tip = parse_tip(*words)
        except ArmdError as error:
            answer(str(error), False)
        else:
            self._changes.keep_tip(name, tip, answer)

    # --- events --------------------------------------------------------------------------

    def _pass_on(self, event: Event) -> None:
        self._supervisor.note_event(event)
        self._tell(event)
        if event.kind == "replay_ended":
            self.stop()
        if event.kind == "foreign_arm" and self._config.file.health.foreign_arm == "stop":
            raise ForeignArm(event.text)

    def _tell(self, event: Event) -> None:
        """Publish and log an event for people; a flood of events is grouped."""
        if self._groups.pass_on(event, time.monotonic_ns()):
            self._tell_each(event)

    def _tell_each(self, event: Event) -> None:
        self._log.write(event)
        stamp_ns = time.time_ns() - time.monotonic_ns() + event.monotonic_ns
        self._publisher.events.put(asdict(event) | {"stamp_ns": stamp_ns})

    def _tell_now(
        self, kind: str, text: str, severity: str, detail: dict[str, Any] | None = None
    ) -> None:
        self._tell(Event(kind, text, time.monotonic_ns(), severity, detail or {}))

    # --- between two reads ---------------------------------------------------------------

    def _tick(self, now_ns: int) -> None:
        survive = self._unexpected.survive
        with survive("questions"):
            self._queries.answer()
            self._publisher.look_for_listeners()
        with survive("processor"):
            self._awake.keep(self._driver.connected)
        with survive("changes"):
            if self._reload_asked:
                self._reload_asked = False
                self._systemd.reloading()
                self._changes.reload(lambda *_: self._systemd.ready())  # an event reports it
            self._changes.take()
        with survive("events"):
            self._tell_new(now_ns)
        with survive("health"):
            if self._supervisor.close_second(now_ns):
                self._log.tell_rest()
                self._sender_settled = self._sender_settled or raise_sender_priority()
                self._publisher.put_health(self._supervisor.health(now_ns))
                self._systemd.status(f"{self._supervisor.state}: {self._supervisor.reason}")
        # The watchdog only checks this thread; the supervisor explains a silence of the arm.
        self._systemd.feed_watchdog(now_ns * 1e-9)

    def _tell_new(self, now_ns: int) -> None:
        events = [*self._supervisor.assess(now_ns), *self._rival.look(now_ns)]
        if self._measured is not None:
            events += self._measured.take_events()
        for event in [*events, *self._unexpected.take_events()]:
            self._tell(event)
        for event in self._groups.take_due_events(now_ns):
            self._tell_each(event)

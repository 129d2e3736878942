"""The simulated arm on CAN: encoders and thermometers on one bus, latching at each SYNC."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from armd.drivers.can import objects as can
from armd.simulator.canbus.node import SimulatedNode
from armd.simulator.canbus.parts import Encoder, Thermometer
from armd.simulator.canbus.timeline import Instant, Timeline
from armd.simulator.canbus.wires import BusEnd, Frame
from armd.simulator.live.device_clock import DeviceClock
from armd.simulator.live.electronics import Electronics
from armd.simulator.live.faults import Fault, Schedule
from armd.simulator.live.physics import Block
from armd.simulator.live.scenario import Scenario
from armd.simulator.live.truth_log import FaultLog, TruthFile

TICK_S = 0.005  # time step of heartbeats and faults while there is no SYNC
SYNCS_STOPPED_NS = 50_000_000
TEMPERATURE_NS = 500_000_000
ALARM_POSITION, WARNING_LIGHT = 0x0001, 0x0004  # bits of 6503 and of 6505
EMCY_HARDWARE, EMCY_NONE, REGISTER_GENERIC = 0x5000, 0x0000, 0x01


class CanArm:
    """All nodes of one arm; `run` is their only loop.

    CAN carries no number of a latch, so the truth file's first column is the latch's instant on the
    host's CLOCK_MONOTONIC in ns.
    """

    def __init__(
        self,
        scenario: Scenario,
        blocks: Iterator[Block],
        wire: BusEnd,
        truth: TruthFile,
        log: FaultLog,
        electronics: Electronics,
    ) -> None:
        self._scenario = scenario
        self._wire = wire
        self._truth = truth
        self._log = log
        self._timeline = Timeline(blocks)
        self._schedule = Schedule(scenario.fault, scenario.rate_hz)
        self._electronics = electronics
        self._turns = electronics.parts.counts_per_turn
        self._encoders = [Encoder(k, turn) for k, turn in enumerate(self._turns, 1)]
        modules = -(-len(self._timeline.advance_to(0.0).sensor_c) // can.CHANNELS_PER_MODULE)
        self._thermometers = [Thermometer(node) for node in can.TEMPERATURE_NODES[:modules]]
        self._nodes: list[SimulatedNode] = [*self._encoders, *self._thermometers]
        self._clock = DeviceClock(scenario.rate_hz, scenario.clock_ppm)
        self._start_ns = 0
        self._sync_k = 0  # the next of our own SYNCs
        self._syncs = 0
        self._last_sync_ns = 0
        self._next_temperature_ns = 0

    def run(self) -> None:
        """Run for the scenario's seconds, or until interrupted."""
        seconds = self._scenario.seconds
        self._clock.start()
        self._start_ns = self._clock.instant_ns(0)
        self._log.write("start", start_monotonic_ns=self._start_ns, **self._now())
        while seconds is None or self._elapsed_s() < seconds:
            frames = self._wire.receive(self._patience_s())
            syncs_left = sum(frame.can_id == can.SYNC_ID for frame in frames)
            for frame in frames:
                if frame.can_id == can.SYNC_ID:
                    syncs_left -= 1
                    self._on_sync(self._spaced(frame.arrival_ns, syncs_left))
                else:
                    for node in self._nodes:
                        node.hear(frame)
            if self._scenario.sync_producer:
                self._produce_syncs()
            self._tick()
            self._flush()

    def close(self) -> None:
        """Finish the fault log."""
        if any(node.preset_written for node in self._nodes):
            self._log.write("preset_written")
        self._log.write("stop", **self._now())

    def _spaced(self, arrival_ns: int, syncs_left: int) -> int:
        """Return when a SYNC came of which *syncs_left* more were read together with it.

        They all carry the last one's arrival, because this process was late: space them evenly.
        """
        since_last_ns = min(arrival_ns - self._last_sync_ns, SYNCS_STOPPED_NS)
        return arrival_ns - since_last_ns * syncs_left // (syncs_left + 1)

    def _patience_s(self) -> float:
        """Return how long to wait for frames until something is due."""
        if not self._scenario.sync_producer:
            return TICK_S
        wait_ns = self._clock.instant_ns(self._sync_k) - time.monotonic_ns()
        return min(max(wait_ns * 1e-9, 0.0), TICK_S)

    def _produce_syncs(self) -> None:
        """Send one SYNC if one is due; missed ones are skipped, as by any late producer."""
        due_k = self._clock.latches_by(time.monotonic_ns())
        if due_k > self._sync_k:
            self._sync_k = due_k
            self._wire.send([Frame(can.SYNC_ID, b"")])
            self._on_sync(time.monotonic_ns())

    def _on_sync(self, now_ns: int) -> None:
        """Let every node latch at the SYNC's arrival and answer with its TPDOs."""
        self._last_sync_ns = now_ns
        self._change_faults()
        instant = self._timeline.advance_to((now_ns - self._start_ns) * 1e-9)
        self._latch(instant, now_ns)
        self._truth.append(np.array([now_ns], np.uint64), instant.tip_mm[None])
        self._syncs += 1
        for node in self._nodes:
            if not node.mute:
                node.on_sync()
        self._flush()

    def _tick(self) -> None:
        """Do the work that does not depend on SYNC."""
        now_ns = time.monotonic_ns()
        if now_ns - self._last_sync_ns > SYNCS_STOPPED_NS:
            # With SYNCs, a change waits for the next one: a fault of 0 s affects exactly one.
            self._change_faults()
            self._latch(self._timeline.advance_to((now_ns - self._start_ns) * 1e-9), now_ns)
        for node in self._nodes:
            node.tick(now_ns)

    def _flush(self) -> None:
        frames = [frame for node in self._nodes for frame in node.outbox]
        for node in self._nodes:
            node.outbox.clear()
        if frames:
            self._wire.send(frames)

    def _latch(self, instant: Instant, now_ns: int) -> None:
        counts = self._electronics.counts(instant.encoder_rad[None])[0]
        for encoder, count in zip(self._encoders, counts, strict=True):
            encoder.count = int(count)
        for fault in self._schedule.active:
            if fault.name == "count_jump":
                encoder = self._encoders[fault.joint - 1]
                encoder.count = int(encoder.count + fault.size) % self._turns[fault.joint - 1]
        if now_ns >= self._next_temperature_ns:
            self._next_temperature_ns = now_ns + TEMPERATURE_NS
            self._measure_temperatures(instant)

    def _measure_temperatures(self, instant: Instant) -> None:
        celsius = np.full(len(self._thermometers) * can.CHANNELS_PER_MODULE, np.nan)
        celsius[: len(instant.sensor_c)] = self._electronics.celsius(instant.sensor_c)
        for fault in self._schedule.active:
            if fault.name == "sensor_open":
                celsius[fault.channel - 1] = np.nan
            elif fault.name == "temperature_step":
                celsius[fault.channel - 1] += fault.size
        for module, channels in zip(
            self._thermometers, np.split(celsius, len(self._thermometers)), strict=True
        ):
            module.celsius = channels

    # faults

    def _change_faults(self) -> None:
        latch = int(self._elapsed_s() * self._scenario.rate_hz)
        if latch < self._schedule.next_change:
            return
        ended, begun = self._schedule.advance(latch)
        self._next_temperature_ns = 0  # a sensor's fault shows at the next latch
        self._set_states()
        for fault in ended:
            self._log.write("end", fault=fault.name, **self._now())
            self._end(fault)
        for fault in begun:
            self._log.begin(fault, **self._now())
            if fault.name == "emcy":
                self._encoders[fault.joint - 1].emergency(EMCY_HARDWARE, REGISTER_GENERIC)

    def _set_states(self) -> None:
        """Bring bus and nodes into the state of the active faults."""
        if self._schedule.is_on("bus_down"):
            self._wire.down()
        else:
            self._wire.up()
        all_mute = self._schedule.is_on("silence") or self._schedule.is_on("reboot")
        for node in self._nodes:
            fault_names = {f.name for f in self._schedule.active if f.joint == node.node_id}
            node.mute = all_mute or bool(fault_names & {"node_silent", "node_reboot"})
            node.no_heartbeat = "heartbeat_loss" in fault_names
            node.no_pdo = "missing_tpdo" in fault_names
            if isinstance(node, Encoder):
                node.alarms = ALARM_POSITION if "joint_invalid" in fault_names else 0
                node.warnings = WARNING_LIGHT if "joint_warning" in fault_names else 0
        for module in self._thermometers:
            module.no_pdo = self._schedule.is_on("sensor_silent")

    def _end(self, fault: Fault) -> None:
        if fault.name == "emcy":
            self._encoders[fault.joint - 1].emergency(EMCY_NONE, 0)
        elif fault.name == "node_reboot":
            self._encoders[fault.joint - 1].boot()
        elif fault.name == "reboot":
            for node in self._nodes:
                node.boot()

    def _elapsed_s(self) -> float:
        return (time.monotonic_ns() - self._start_ns) * 1e-9

    def _now(self) -> dict[str, int | float]:
        return {
            "syncs": self._syncs,
            "at_s": round(self._elapsed_s(), 6),
            "monotonic_ns": time.monotonic_ns(),
        }

"""The simulated arm on the serial wire: latches at its deadlines, packets, answers."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator

import numpy as np
from cobs import cobs

from armd.drivers.serial import wire
from armd.simulator.live.device_clock import DeviceClock
from armd.simulator.live.electronics import Electronics
from armd.simulator.live.faults import Schedule
from armd.simulator.live.physics import Block
from armd.simulator.live.pty_port import PtyPort
from armd.simulator.live.scenario import Scenario
from armd.simulator.live.truth_log import FaultLog, TruthFile
from armd.simulator.serial.block_buffer import BlockBuffer
from armd.simulator.serial.faults import SpoiltLine

TEMPERATURES_PER_S = 2
#: A wake-up is late by tens of µs: up to SPIN_HZ, the last EARLY_NS before a latch are busy-waited.
EARLY_NS, SPIN_HZ = 60_000, 2000
#: Pause after sending, for the reader, before the next physics are prepared: a real arm does not
#: share its processor with the host.
ON_ITS_WAY_NS = 300_000
#: After a stall of this machine, overdue packets are sent in pieces, hardly faster than by a real
#: line, so that the reader, which stalled as well, can keep up.
AT_ONCE_S, BETWEEN_S = 0.05, 0.002
#: Faults during which no SAMPLE is sent, the strongest first.
MUTE = ("reboot", "unplug", "silence")


class SerialDevice:
    """One arm on one port, from boot until `run` returns.

    Everything is counted in latches since the simulator started (*k*); a boot sets the origin of
    the device's own counter and clock.
    """

    def __init__(
        self,
        scenario: Scenario,
        blocks: Iterator[Block],
        port: PtyPort,
        truth: TruthFile,
        log: FaultLog,
        electronics: Electronics,
    ) -> None:
        self._scenario = scenario
        self._schedule = Schedule(scenario.fault, scenario.rate_hz)
        self._port = port
        self._truth = truth
        self._log = log
        self._rng = np.random.default_rng([scenario.seed, 0x5E1])
        self._electronics = electronics
        self._clock = DeviceClock(scenario.rate_hz, scenario.clock_ppm)
        self._early_ns = EARLY_NS if scenario.rate_hz <= SPIN_HZ else 0
        self._max_batch = max(1, round(AT_ONCE_S * scenario.rate_hz))
        self._commands = wire.CobsSplitter()
        self._line = SpoiltLine(self._schedule, self._rng, electronics.parts.counts_per_turn)
        self._mute = ""  # the fault that keeps the arm silent
        self._k = 0
        self._boot_k = 0
        self._boot_id = 0
        self._boot_seq = scenario.first_seq  # epoch << 32 | device seq at the last boot
        self._buffer = BlockBuffer(blocks, self._electronics)
        self._truth_k = 0
        self._next_temperature_k = 0
        self._packed = (-1, b"")  # a latch, and its packet without faults

    def run(self) -> None:
        """Run for the scenario's seconds, or until interrupted."""
        seconds = self._scenario.seconds
        stop_k = sys.maxsize if seconds is None else round(seconds * self._clock.rate_hz)
        self._clock.start()
        self._boot()
        while self._k < stop_k:
            due_k = min(self._clock.latches_by(time.monotonic_ns()), stop_k)
            spare_time = self._k < due_k  # the next latch is a whole period away
            while self._k < due_k:
                if self._k >= self._schedule.next_change:
                    self._change_faults()
                most_k = self._k + self._max_batch
                self._latch_until(
                    min(due_k, most_k, self._buffer.end_k, self._schedule.next_change)
                )
                if self._k == most_k:
                    time.sleep(BETWEEN_S)
                if self._k == self._buffer.end_k:
                    if self._k == due_k:
                        self._let_it_arrive()
                    self._take_block()
            if spare_time and self._k >= self._buffer.middle_k and not self._buffer.prepared:
                self._let_it_arrive()
                self._buffer.prepare()
            # Packed in advance: at its latch a sample only has to be sent.
            self._packed = (
                self._k,
                wire.pack(self._rows[self._k - self._buffer.first_k].tobytes()),
            )
            self._wait(self._clock.instant_ns(self._k))

    def close(self) -> None:
        """Write the truth up to the last latch, and finish the fault log."""
        self._keep_truth()
        self._log.write("stop", **self._now())

    # latches

    def _latch_until(self, end_k: int) -> None:
        """Latch k … end − 1, all in the current block and with the same faults.

        It needs one write, and one more for temperatures that follow: no sample waits for later
        data.
        """
        first_seq, count = self._seq(self._k), end_k - self._k
        if self._mute:
            if self._mute != "reboot":  # while it reboots, nothing is latched
                self._log.note_withheld(self._mute, first_seq, first_seq + count - 1)
            self._k = end_k
            return
        packets = []
        for k in range(self._k, end_k):
            if k > self._k and k > self._next_temperature_k:
                packets.append(self._temperature(k - 1))
            packets.append(self._sample(k))
        self._k = end_k
        data = b"".join(packets)
        if data and not self._port.write(data):
            self._line.torn = False
            self._log.note_withheld("nobody reads", first_seq, first_seq + count - 1)
        if end_k > self._next_temperature_k:
            self._port.write(self._temperature(end_k - 1))

    def _sample(self, k: int) -> bytes:
        row: np.void = self._rows[k - self._buffer.first_k]
        if self._line.clear:
            return self._packed[1] if k == self._packed[0] else wire.pack(row.tobytes())
        packet, lost_by = self._line.sample(row)
        if lost_by:
            self._log.note_withheld(lost_by, self._seq(k), self._seq(k))
        return packet

    def _temperature(self, k: int) -> bytes:
        self._next_temperature_k = k + max(1, self._clock.rate_hz // TEMPERATURES_PER_S)
        celsius = self._electronics.celsius(self._block.felt_c(k - self._buffer.first_k))
        return self._line.temperature(self._clock.latch_us(k - self._boot_k), celsius)

    # blocks of physics

    @property
    def _block(self) -> Block:
        return self._buffer.block

    def _take_block(self) -> None:
        self._keep_truth()
        self._buffer.take()
        self._stamp()

    def _stamp(self) -> None:
        """Make the block's SAMPLE bodies, numbered and timed from the last boot."""
        n, n_joints = self._block.encoder_rad.shape
        self._rows = np.zeros(n, wire.make_sample_layout(n_joints))
        since_boot = np.arange(self._buffer.first_k, self._buffer.first_k + n) - self._boot_k
        self._rows["type"], self._rows["n"] = wire.Type.SAMPLE, n_joints
        self._rows["seq"] = (self._boot_seq + since_boot) & 0xFFFFFFFF
        self._rows["t_us"] = since_boot.clip(0) * 1_000_000 // self._clock.rate_hz
        self._rows["buttons"] = self._block.buttons
        self._rows["count"] = self._buffer.counts

    def _keep_truth(self) -> None:
        """Write the truth of the block's past latches that is not written yet."""
        if self._mute != "reboot":
            first_k = max(self._buffer.first_k, self._boot_k, self._truth_k)
            rows = slice(first_k - self._buffer.first_k, self._k - self._buffer.first_k)
            seq = np.arange(self._seq(first_k), self._seq(self._k), dtype=np.uint64)
            self._truth.append(seq, self._block.tip_mm[rows])
        self._truth_k = self._k

    # faults and boots

    def _change_faults(self) -> None:
        ended, begun = self._schedule.advance(self._k)
        for fault in ended:
            self._log.write("end", fault=fault.name, **self._now())
        for fault in begun:
            self._log.begin(fault, **self._now())
        rebooting = self._mute == "reboot"
        if not rebooting and self._schedule.is_on("reboot"):
            self._keep_truth()
        self._mute = next((name for name in MUTE if self._schedule.is_on(name)), "")
        if self._schedule.is_on("unplug"):
            self._port.unplug()
        elif not self._port.plugged:
            self._plug()
        if rebooting and self._mute != "reboot":
            self._boot_seq = ((self._seq(self._k) >> 32) + 1) << 32
            self._boot_k = self._k
            self._boot()

    def _plug(self) -> None:
        before = self._port.path
        self._port.plug()
        self._line.torn = False
        self._commands.reset()
        if self._port.path != before:
            print(self._port.path, flush=True)

    def _boot(self) -> None:
        self._boot_id = int(self._rng.integers(1 << 32))
        self._truth_k = self._k
        self._next_temperature_k = self._k
        self._line.torn = False
        self._stamp()
        self._packed = (-1, b"")
        self._send_hello()
        self._log.write(
            "boot",
            boot_id=self._boot_id,
            clock_ppm=self._clock.ppm,
            rate_hz=self._clock.rate_hz,
            latch_monotonic_ns=self._clock.instant_ns(self._k),
            **self._now(),
        )

    def _seq(self, k: int) -> int:
        """Return the published number: epoch << 32 | device seq."""
        return self._boot_seq + k - self._boot_k

    def _now(self) -> dict[str, int | float]:
        """Return number and times of the next latch, for the fault log."""
        return {
            "seq": self._seq(self._k),
            "t_us": self._clock.latch_us(self._k - self._boot_k),
            "at_s": self._k / self._clock.rate_hz,
            "monotonic_ns": time.monotonic_ns(),
        }

    # the host's side of the conversation

    def _wait(self, instant_ns: int) -> None:
        """Wait until the next latch, or the host's next bytes."""
        if not self._listen(instant_ns - self._early_ns):
            while time.monotonic_ns() < instant_ns:  # busy-wait, as the scheduler may be late
                pass

    def _let_it_arrive(self) -> None:
        """Pause for the reader, while samples come one by one."""
        if self._early_ns:
            self._listen(time.monotonic_ns() + ON_ITS_WAY_NS)

    def _listen(self, until_ns: int) -> bool:
        """Wait until an instant or the host's next bytes; answer these and return if there were
        any.
        """
        timeout_s = max(0, until_ns - time.monotonic_ns()) * 1e-9
        if not self._port.plugged:
            time.sleep(timeout_s)
            return False
        received = self._port.read(timeout_s)
        now_us = self._clock.device_us(time.monotonic_ns())
        for packet in self._commands.push(received) if received else ():
            if not self._mute:
                self._answer(packet, now_us - self._clock.latch_us(self._boot_k))
        return bool(received)

    def _answer(self, packet: bytes, t_us: int) -> None:
        try:
            data = wire.unpack(packet)
        except cobs.DecodeError:
            return
        if data is None:
            return
        if data[0] == wire.Type.IDENTIFY:
            self._send_hello()
        elif data[0] == wire.Type.PING and (nonce := wire.decode_ping(data)) is not None:
            self._port.write(self._line.pass_intact(wire.encode_pong(nonce, t_us)))

    def _send_hello(self) -> None:
        hello = wire.Hello(
            protocol=wire.PROTOCOL,
            n_joints=self._block.encoder_rad.shape[1],
            n_sensors=self._block.sensor_c.shape[1],
            rate_hz=self._clock.rate_hz,
            boot_id=self._boot_id,
            serial_number=self._scenario.serial_number,
            bits=self._electronics.parts.bits,
        )
        self._port.write(self._line.pass_intact(wire.encode_hello(hello)))

"""Decodes raw frames of a serial line to samples, temperatures and events, without port or clock.

Everything depends only on the frames fed, so a recording replays to the same samples, and a test
needs no hardware.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from cobs import cobs

from armd.drivers.identity import Expectation
from armd.drivers.sample import Event, Item, RawFrame, Temperatures
from armd.drivers.serial import wire
from armd.drivers.serial.assembler import SampleAssembler
from armd.drivers.serial.clock import EAGER_INTERVAL_NS, ClockMapping
from armd.drivers.serial.exchanges import Exchanges
from armd.drivers.serial.reading_buffer import HeldReading, ReadingBuffer, count_packets
from armd.drivers.serial.sequence import Rows, Run, SequenceExtender
from armd.drivers.unwrap import MAX_JOINT_RATE_DEG_S

EPOCH = b"epoch "  # a "link" frame with the epoch in which a recording begins
COUNTED = (
    *("bad_crc", "bad_cobs", "malformed", "unknown", "foreign", "unidentified"),
    "clock_contradictions",
)


class SerialDecoder:
    """Decodes every `RawFrame` of a line in order, sent ones too: they carry the PING times.

    Samples that arrive before HELLO has identified the arm are held. Then they are delivered, or
    dropped if the arm is a foreign one.
    """

    def __init__(
        self, expectation: Expectation, max_joint_rate_deg_s: float = MAX_JOINT_RATE_DEG_S
    ) -> None:
        self.clock = ClockMapping()
        self.hello: wire.Hello | None = None  # of the connected arm, expected or not
        self.accepted = False  # whether `hello` is the expected arm's
        self.last_sample_ns: int | None = None  # arrival of the last good SAMPLE, host monotonic
        self._expected = expectation
        self._assembler = SampleAssembler(expectation.n_joints, self.clock, max_joint_rate_deg_s)
        self._splitter = wire.CobsSplitter()
        self._synchronised = False  # a first 0x00 has been seen on this connection
        self._sequence = SequenceExtender()
        self._boot_id: int | None = None
        self._exchanges = Exchanges(self.clock)
        self._greeting: RawFrame | None = None  # the frame that identified the arm
        self._warmth: RawFrame | None = None  # the last frame with temperatures
        self._held_readings = ReadingBuffer()
        self._counted: Counter[str] = Counter()

    @property
    def counters(self) -> dict[str, int]:
        """The number of good samples, and of each kind of packet not delivered, since the
        beginning.
        """
        return {name: self._counted[name] for name in COUNTED} | {
            "samples": self._assembler.delivered,
            "junk": self._splitter.junk,
            "lost": self._sequence.lost,
            "repeated": self._sequence.repeated,
        }

    @property
    def wants_identity(self) -> bool:
        """Whether HELLO is missing: since the connection, or since a reboot that only the clock
        showed.
        """
        return self.hello is None

    @property
    def ping_interval_ns(self) -> int:
        """The interval between a PING and the next one."""
        doubt = self._sequence.wants_clock
        return EAGER_INTERVAL_NS if doubt else self.clock.ping_interval_ns

    def feed(self, frame: RawFrame) -> list[Item]:
        """Decode *frame*; return the items that it completes, in the order of the wire."""
        if frame.direction == "link":
            if frame.data.startswith(EPOCH):
                self._sequence.start_in(int(frame.data.removeprefix(EPOCH)))
            else:
                self._connection_changed()
            return []
        if frame.direction == "tx":
            self._exchanges.sent(frame)
            return []
        return self._decode(frame)

    def warm_up(self) -> None:
        """Compile the decoder, or load it from the cache, before the first sample arrives."""
        self._assembler.warm_up()

    def preamble(self) -> list[RawFrame]:
        """Return the frames from which a fresh decoder continues.

        They hold epoch, identity, temperatures and the exchanges that determine the clock.
        """
        if not self.accepted or self._greeting is None:
            return []
        epoch = EPOCH + b"%d" % self._sequence.epoch
        frames = [self._greeting._replace(direction="link", data=epoch), self._greeting]
        if self._warmth is not None:
            frames.append(self._warmth)
        return frames + self._exchanges.frames()

    # --- packets -------------------------------------------------------------------------

    def _decode(self, frame: RawFrame) -> list[Item]:
        if self.accepted:
            items = self._plain_samples(frame)
            if items is not None:
                return items
        items = []
        run: list[bytes] = []  # consecutive SAMPLEs, decoded at once
        for packet in self._splitter.push(frame.data):
            data = self._unpack(packet)
            if data is None:
                continue
            if data[0] == wire.Type.SAMPLE:
                if wire.is_sample(data, self._expected.n_joints):
                    run.append(data)
                else:
                    self._counted["malformed"] += 1
                continue
            items += self._samples(run, frame)
            run = []
            items += self._process_other(data, frame)
        return items + self._samples(run, frame)

    def _plain_samples(self, frame: RawFrame) -> list[Item] | None:
        """Decode the usual case: only SAMPLEs, which directly follow the last ones.

        Otherwise it does nothing and returns None.
        """
        data, tail = self._splitter.cut(frame.data)
        arrival_ns = frame.monotonic_ns
        items = self._assembler.go_on(data, self._sequence, arrival_ns, frame.unix_ns - arrival_ns)
        if items is not None:
            self._splitter.keep(tail)
            self._synchronised = True
            self.last_sample_ns = arrival_ns
        return items

    def _unpack(self, packet: bytes) -> bytes | None:
        synchronised, self._synchronised = self._synchronised, True
        try:
            data = wire.unpack(packet)
            fault = "bad_crc"
        except cobs.DecodeError:
            data, fault = None, "bad_cobs"
        if data is None and synchronised:  # otherwise: the tail of a packet, which is no fault
            self._counted[fault] += 1
        return data

    def _process_other(self, data: bytes, frame: RawFrame) -> list[Item]:
        match data[0]:
            case wire.Type.TEMPERATURE:
                reading = wire.decode_temperature(data)
                if reading is not None:
                    self._warmth = frame._replace(data=wire.pack(data[:-4]))
                    return self._deliver_or_hold(reading, frame)
            case wire.Type.HELLO:
                hello = wire.decode_hello(data)
                if hello is not None:
                    return self._greet(hello, frame)
            case wire.Type.PONG:
                pong = wire.decode_pong(data)
                if pong is not None:
                    return self._exchange(pong, frame)
            case _:
                self._counted["unknown"] += 1
                return []
        self._counted["malformed"] += 1
        return []

    def _exchange(self, pong: wire.Pong, frame: RawFrame) -> list[Item]:
        ping = self._exchanges.take(pong.nonce)
        if ping is None:
            return []
        runs = self._sequence.clock_read(pong.t_us, ping.monotonic_ns)
        items = self._assemble(runs, frame.monotonic_ns, frame.unix_ns - frame.monotonic_ns)
        agrees = self._exchanges.answered(ping, pong, frame, self._sequence)
        self._counted["clock_contradictions"] += not agrees
        return items

    def _samples(self, run: list[bytes], frame: RawFrame) -> list[Item]:
        if not run:
            return []
        rows = wire.decode_samples(run, self._expected.n_joints)
        self.last_sample_ns = frame.monotonic_ns
        return self._deliver_or_hold(rows, frame)

    # --- whose arm -----------------------------------------------------------------------

    def _connection_changed(self) -> None:
        """Forget identity and clock: another connection may be another arm."""
        self._splitter.reset()
        self._synchronised = False
        self._counted["unidentified"] += self._held_readings.forget()
        self._exchanges.forget()
        self.hello = None
        self.accepted = False

    def _greet(self, hello: wire.Hello, frame: RawFrame) -> list[Item]:
        if hello == self.hello:
            return []
        self.hello = hello
        faults = (
            [f"protocol: found {hello.protocol}, expected {wire.PROTOCOL}"]
            if hello.protocol != wire.PROTOCOL
            else self._expected.mismatches(
                hello.serial_number, hello.n_joints, [1 << b for b in hello.bits]
            )
        )
        if not faults and not all(1 <= b <= 32 for b in hello.bits):
            faults = [f"bits: found {list(hello.bits)}, expected 1 to 32 each"]
        self.accepted = not faults
        if faults:
            self._counted["foreign"] += self._held_readings.forget()
            text = f"a foreign arm is connected: {'; '.join(faults)}"
            return [Event("foreign_arm", text, frame.monotonic_ns, "error", {"faults": faults})]
        items = self._welcome(hello, frame)
        unix_minus_monotonic_ns = frame.unix_ns - frame.monotonic_ns
        for rows, arrival_ns in self._sequence.take_cleared():
            items += self._follow(rows, arrival_ns, unix_minus_monotonic_ns)
        for reading, arrival_ns, unix_ns in self._held_readings.take():
            items += self._deliver(reading, arrival_ns, unix_ns)
        return items

    def _welcome(self, hello: wire.Hello, frame: RawFrame) -> list[Item]:
        """Accept the expected arm, and detect whether it has booted since the last HELLO."""
        detail = {
            "serial_number": hello.serial_number,
            "boot_id": hello.boot_id,
            "rate_hz": hello.rate_hz,
            "n_sensors": hello.n_sensors,
        }
        items: list[Item] = []
        if self._boot_id is not None and hello.boot_id != self._boot_id:
            self._sequence.new_boot()
            self._new_boot()
            items.append(Event("reboot", "the arm has rebooted", frame.monotonic_ns, "warning"))
        self._boot_id = hello.boot_id
        self._greeting = frame._replace(data=wire.encode_hello(hello))
        self._assembler.set_bits(hello.bits)
        text = f"arm {hello.serial_number} identified, {hello.rate_hz} samples a second"
        items.append(Event("identified", text, frame.monotonic_ns, "info", detail))
        if hello.n_sensors != self._expected.n_sensors:
            text = (
                f"temperature sensors: found {hello.n_sensors}, expected "
                f"{self._expected.n_sensors}; missing ones count as invalid"
            )
            items.append(Event("sensor_count", text, frame.monotonic_ns, "warning"))
        return items

    def _new_boot(self) -> None:
        """Reset the device's clock and its encoders' turns."""
        self._exchanges.forget()
        self._assembler.new_boot()

    # --- holding and delivering ----------------------------------------------------------

    def _deliver_or_hold(self, reading: HeldReading, frame: RawFrame) -> list[Item]:
        if self.accepted:
            return self._deliver(reading, frame.monotonic_ns, frame.unix_ns)
        if self.hello is not None:
            self._counted["foreign"] += count_packets(reading)
            return []
        dropped = self._held_readings.add(reading, frame.monotonic_ns, frame.unix_ns)
        self._counted["unidentified"] += dropped
        return []

    def _deliver(self, reading: HeldReading, arrival_ns: int, unix_ns: int) -> list[Item]:
        if isinstance(reading, wire.TemperatureReading):
            return [self._temperatures(reading, arrival_ns, unix_ns - arrival_ns)]
        return self._follow(reading, arrival_ns, unix_ns - arrival_ns)

    def _follow(self, rows: Rows, arrival_ns: int, unix_minus_monotonic_ns: int) -> list[Item]:
        """Assemble rows that may not follow the last ones."""
        runs = self._sequence.push(rows, arrival_ns)
        return self._assemble(runs, arrival_ns, unix_minus_monotonic_ns)

    def _assemble(self, runs: list[Run], now_ns: int, unix_minus_monotonic_ns: int) -> list[Item]:
        items: list[Item] = []
        for run in runs:
            if run.rebooted:
                self._new_boot()
                self._boot_id = None
                self.hello = None  # identify again, but continue: the line was never broken
                text = "the arm has rebooted: its clock runs from zero again"
                items.append(Event("reboot", text, now_ns, "warning"))
            items += self._assembler.assemble(run, unix_minus_monotonic_ns)
        return items

    def _temperatures(
        self, reading: wire.TemperatureReading, arrival_ns: int, unix_minus_monotonic_ns: int
    ) -> Temperatures:
        celsius = np.full(self._expected.n_sensors, np.nan)
        n = min(len(celsius), len(reading.celsius))
        celsius[:n] = reading.celsius[:n]
        device_ns = reading.t_us * 1000
        instant_ns = arrival_ns
        if self.clock.mapped:  # a reading from the future would never become old
            instant_ns = min(self.clock.to_host(device_ns), arrival_ns)
        return Temperatures(celsius, device_ns, instant_ns, instant_ns + unix_minus_monotonic_ns)

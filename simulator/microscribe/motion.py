"""A MicroScribe's streaming ("respond to motion"), its timer, and a line that loses bytes."""

from __future__ import annotations

import math

import numpy as np

from armd.drivers.microscribe import wire
from armd.simulator.live.faults import Fault
from armd.simulator.live.pty_port import PtyPort

READ_TO_LINE_S = 0.0006  # from a reading to its first bit


class Timer:
    """Ticks of 1/900 s of a crystal that is *ppm* parts per million fast, from *first* on."""

    HZ = 900

    def __init__(self, ppm: float, first: int) -> None:
        self._hz = self.HZ * (1 + ppm * 1e-6)
        self._ppm, self._first = ppm, first

    def restarted(self, t_s: float) -> Timer:
        """Return a timer that reads 0 at *t_s*, after a power-up."""
        return Timer(self._ppm, -math.floor(t_s * self._hz))

    def ticks(self, t_s: float) -> int:
        return self._first + math.floor(t_s * self._hz)

    def begin_s(self, ticks: int) -> float:
        """Return when a tick begins."""
        return (ticks - self._first) / self._hz + 1e-9


class MotionReport:
    """One command to respond to motion, at the pace of its delay, the timer's ticks and the line.

    In turn: `read` at `due_s`, and `packet` has passed the line at the next `due_s`. The maker
    states that the delay has ticks of about 1 ms; here they are those of the timer.
    """

    COMMAND_BYTES = 25

    def __init__(self, heard: bytes, timer: Timer, baud: int, now_s: float) -> None:
        self._command, delay = wire.parse_streamed_command(heard)
        self._buttons = heard[4]
        self._changes = np.frombuffer(heard[13:25], ">u2")
        self._timer = timer
        self._line_s = READ_TO_LINE_S + wire.get_standard_size(self._command) * 10 / baud
        self._every = max(delay, math.ceil(self._line_s * Timer.HZ))
        self._tick = timer.ticks(now_s)
        self._sent: wire.StandardReply | None = None
        self.packet = b""
        self._next()

    def read(self, reading: wire.StandardReply) -> None:
        """Take a reading at the beginning of a tick."""
        if self._must_send(reading):
            self._sent = reading
            self.packet = wire.encode_standard(self._command, reading)
            self.due_s += self._line_s
        else:
            self._next()

    def drop_packet(self) -> None:
        self.packet = b""
        self._next()

    def finish(self, now_s: float) -> float:
        """Return the seconds until the line is free."""
        return max(0.0, self.due_s - now_s) if self.packet else 0.0

    def _next(self) -> None:
        self._tick += self._every
        self.due_s = self._timer.begin_s(self._tick)

    def _must_send(self, reading: wire.StandardReply) -> bool:
        if not self._buttons and not self._changes.any():
            return True
        if self._sent is None:
            return True
        moved = np.abs(np.subtract(reading.counts, self._sent.counts))
        enough = (self._changes[: len(moved)] > 0) & (moved >= self._changes[: len(moved)])
        return bool(enough.any() or (reading.buttons ^ self._sent.buttons) & self._buttons)


class SpoiltPort:
    """A port that loses and inserts bytes."""

    def __init__(self, port: PtyPort, rng: np.random.Generator) -> None:
        self._port, self._rng = port, rng
        self._on: list[Fault] = []
        self._to_lose = 0  # number of the next bytes to lose

    def fault(self, fault: Fault, begins: bool) -> None:
        """Begin or end a fault; one without duration affects only the next packet."""
        if fault.name in ("lost_byte", "inserted_byte"):
            if begins:
                self._on.append(fault)
            elif fault.seconds:
                self._on.remove(fault)

    def write(self, data: bytes) -> None:
        data, self._to_lose = data[self._to_lose :], max(0, self._to_lose - len(data))
        for fault in [*self._on]:
            if not data:
                return
            position, amount = int(self._rng.integers(len(data))), round(fault.size)
            if fault.name == "lost_byte":
                self._to_lose = max(0, amount - (len(data) - position))
                data = data[:position] + data[position + amount :]
            else:
                data = data[:position] + self._rng.bytes(amount) + data[position:]
            if not fault.seconds:
                self._on.remove(fault)
        if data:
            self._port.write(data)

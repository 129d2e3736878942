"""Feetech servos behind a port that is not there, in a time of its own: nothing waits, nothing
depends on the machine.

line = VirtualServoLine(monkeypatch)
driver = line.driver(rate_hz=50)
"""

import heapq
from types import SimpleNamespace

from armd.drivers import host_time, line_health, shell
from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.poll import driver as poll_driver
from support.fake_servos import Feetech

MS = 1_000_000
DESCRIPTOR = 5000  # of no file
PLAIN_READ, WRITE, SYNC_READ = 0x02, 0x03, 0x82


class VirtualServoLine:
    """Answers come 1 ms after a request. `on_request` is called with the number of each, before it
    is answered; what it sets holds from then on."""

    def __init__(self, monkeypatch, ids=(1, 2, 3)):
        self.now_ns = 10**12
        self.registers = {servo: Feetech.table(servo) for servo in ids}
        for registers in self.registers.values():
            Feetech.put_position(registers, 2048)
        self.n_requests = 0
        self.on_request = lambda number: None
        self.refusals = 0  # writes that the line does not take whole
        self.silent = set()  # servos that do not answer
        self.answer_bytes = None  # that come of an answer; None: all
        self.pieces = 1  # in which an answer comes, 1 ms apart
        self.breaks_ns = None  # when the port breaks
        self._arrivals = []
        clock = SimpleNamespace(
            monotonic_ns=lambda: self.now_ns,
            time_ns=lambda: self.now_ns + 10**18,
            sleep=lambda seconds: self._pass(seconds),
        )
        for module in (poll_driver, shell, host_time, line_health):
            monkeypatch.setattr(module, "time", clock)
        monkeypatch.setattr(poll_driver, "has_bytes", self._has_bytes)
        monkeypatch.setattr(shell, "os", SimpleNamespace(read=self._read, write=self._write))
        monkeypatch.setattr(shell, "serial", SimpleNamespace(Serial=self._open))

    def driver(self, **more):
        ids = list(self.registers)
        config = ServoConfig(kind="feetech", port="/nowhere/servos", ids=ids, **more)
        expected = Expectation("SERVO-1", len(ids), len(ids), (4096,) * len(ids))
        return poll_driver.ServoDriver(config, expected)

    def say(self, data, after_ms):
        """*data* come in so many milliseconds, asked for or not."""
        heapq.heappush(self._arrivals, (self.now_ns + round(after_ms * MS), data))

    def break_off(self, after_ms):
        self.breaks_ns = self.now_ns + round(after_ms * MS)

    def _pass(self, seconds):
        self.now_ns += round(seconds * 1e9)

    def _open(self, *_, **__):
        self._arrivals.clear()
        self.breaks_ns = None
        return SimpleNamespace(
            fileno=lambda: DESCRIPTOR, close=lambda: None, set_low_latency_mode=lambda on: None
        )

    def _has_bytes(self, descriptor, seconds):
        due = [at_ns for at_ns, _ in self._arrivals[:1]]
        due += [] if self.breaks_ns is None else [self.breaks_ns]
        until_ns = self.now_ns + round(seconds * 1e9)
        ready = bool(due) and min(due) <= until_ns
        self.now_ns = max(self.now_ns, min(due)) if ready else until_ns
        return ready

    def _read(self, descriptor, most):
        if self.breaks_ns is not None and self.breaks_ns <= self.now_ns:
            raise OSError("the port is gone")
        data = b""
        while self._arrivals and self._arrivals[0][0] <= self.now_ns:
            data += heapq.heappop(self._arrivals)[1]
        return data

    def _write(self, descriptor, data):
        self.now_ns += MS // 100
        if self.refusals:
            self.refusals -= 1
            return len(data) - 1
        ((instruction, servo, params),) = Feetech.requests(data)[0]
        number, self.n_requests = self.n_requests, self.n_requests + 1
        self.on_request(number)
        answer = self._answer(instruction, servo, params)[: self.answer_bytes]
        for k in range(self.pieces):
            size = -(-len(answer) // self.pieces)
            if piece := answer[k * size : (k + 1) * size]:
                self.say(piece, 1 + k)
        return len(data)

    def _answer(self, instruction, servo, params):
        if instruction == WRITE:
            address, values = Feetech.write(params)
            self.registers[servo][address : address + len(values)] = values
            return Feetech.status(servo, 0, b"")
        address, length, ids = Feetech.span(params)
        ids = {PLAIN_READ: [servo], SYNC_READ: list(ids)}[instruction]
        return b"".join(
            Feetech.status(servo, 0, self.registers[servo][address : address + length])
            for servo in ids
            if servo not in self.silent
        )

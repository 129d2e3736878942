"""A serial line to ask on: one request, and what comes back within a while."""

from __future__ import annotations

import select
import time
from types import TracebackType

import serial

from armd.drivers.poll.family import Family
from armd.drivers.poll.packet import Packet

BYTES = 4096


class Line:
    """An open port; raises OSError or ValueError where it cannot be opened."""

    def __init__(self, port: str, baud: int) -> None:
        self.baud = baud
        self._port = serial.Serial(port, baud, timeout=0, exclusive=True)

    def __enter__(self) -> Line:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._port.close()

    def set_baud(self, baud: int) -> bool:
        """Whether the adapter can."""
        try:
            self._port.baudrate = baud
        except (OSError, ValueError):
            return False
        self.baud = baud
        return True

    def send(self, data: bytes) -> None:
        self._port.reset_input_buffer()
        self._port.write(data)

    def hear(self, seconds: float) -> bytes:
        """What comes first within *seconds*; empty if nothing does."""
        if not select.select([self._port.fileno()], [], [], max(0.0, seconds))[0]:
            return b""
        return bytes(self._port.read(BYTES))

    def ask(self, family: Family, request: bytes, answers: int, wait_s: float) -> list[Packet]:
        """The packets that come, until there are *answers* of them; the request's own echo, which
        some adapters hear, is none. *wait_s* is without the bytes' own time."""
        splitter = family.splitter()
        self.send(request)
        deadline = time.monotonic() + wait_s + 10 * len(request) / self.baud
        packets: list[Packet] = []
        echo = request
        while len(packets) < answers:
            heard = self.hear(deadline - time.monotonic())
            if not heard:
                break
            if echo:  # of a servo's ping the answer has the request's form: by place, not by look
                n = min(len(echo), len(heard))
                echo, heard = (echo[n:], heard[n:]) if heard[:n] == echo[:n] else (b"", heard)
            deadline = max(deadline, time.monotonic() + 0.004)
            packets += splitter.push(heard)
        return packets

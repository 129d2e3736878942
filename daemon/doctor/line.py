"""A serial line for requests: send one, and receive the answers within a time."""

from __future__ import annotations

import time
from collections.abc import Collection

import serial

from armd.closing import Closing
from armd.drivers.poll.protocol.family import Family
from armd.drivers.poll.protocol.packet import Packet
from armd.drivers.ports import is_pseudo
from armd.drivers.waiting import has_bytes

BYTES = 4096
ECHO_S = 0.1  # an adapter returns bytes within 16 ms, later on a busy host


class Line(Closing):
    """An open port; raises OSError or ValueError where it cannot be opened."""

    def __init__(self, port: str, baud: int) -> None:
        self.baud = baud
        self.echoes = False  # until an echo is detected
        self.heard_bytes = 0
        self._port = serial.Serial(port, baud, timeout=0, exclusive=True)
        self.is_pseudo = is_pseudo(self._port.fileno())

    def close(self) -> None:
        self._port.close()

    def set_baud(self, baud: int) -> bool:
        """Set the rate; return whether the adapter supports it."""
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
        """Return the first bytes within *seconds*; empty if none come."""
        if not has_bytes(self._port.fileno(), max(0.0, seconds)):
            return b""
        heard = bytes(self._port.read(BYTES))
        self.heard_bytes += len(heard)
        return heard

    def hears(self, word: bytes, seconds: float) -> bool:
        """Return whether *word* comes within *seconds*."""
        deadline, heard = time.monotonic() + seconds, b""
        while word not in heard and (chunk := self.hear(deadline - time.monotonic())):
            heard += chunk
        return word in heard

    def detect_echo(self, request: bytes) -> None:
        """Detect whether the adapter echoes; *request* is one that no device answers."""
        self.send(request)
        self.echoes = self.echoes or self.hears(request, ECHO_S)

    def ask(
        self, family: Family, request: bytes, ids: Collection[int], wait_s: float
    ) -> list[Packet]:
        """Return the answers of *ids*, until each has given one.

        *wait_s* is without the bytes' own time. Where the adapter echoes, one packet that equals
        the request is its echo; an echo that comes late has an id that is not asked any more.
        Elsewhere such a packet is an answer: a Feetech's to a ping, with the error bit "voltage".
        """
        splitter = family.splitter()
        self.send(request)
        deadline = time.monotonic() + wait_s + 10 * len(request) / self.baud
        answers: list[Packet] = []
        echo_due, heard = self.echoes, request
        while len(answers) < len(ids) and heard:
            heard = self.hear(deadline - time.monotonic())
            deadline = max(deadline, time.monotonic() + 0.004)
            # At the end, flush packets behind bytes that only look like a packet's beginning.
            for packet in splitter.push(heard) if heard else splitter.flush():
                if echo_due and packet.raw == request:
                    echo_due = False
                elif packet.id in ids:
                    answers.append(packet)
        return answers

"""Packets that the arm sends by itself: which bytes are one, and how many were lost between two.

The wire has no checksum and no number. So a packet counts only if it stands exactly between two
beginnings and the next one's timer is where the pace expects it: a lost, inserted or exchanged
piece of the line costs the packets that it touched, and makes none.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

from armd.drivers.microscribe.wire import MARK, TICKS, get_standard_size, parse_streamed_command
from armd.drivers.sample import RawFrame

PACE_PACKETS = 16  # over which the pace is taken
NEXT = 1.6  # paces after which a packet is not the next one any more
_TIMER_AT = 2  # in a packet: behind its beginning and the buttons
LONGEST = 64  # bytes without a beginning that are kept


class Streamed(NamedTuple):
    packet: bytes
    heard: RawFrame  # that its last byte came with
    ticks: int  # of 14 bits
    lost: int | None  # packets between it and the one before; None: it is the first


class PacketStream:
    """Of one command to stream, *request*."""

    def __init__(self, request: bytes) -> None:
        command, delay = parse_streamed_command(request)
        self.request = request
        self.malformed = 0
        self.packets = 0  # that began and ended
        self._head = command | MARK
        self._size = get_standard_size(command)
        self._open = b""  # what began and may not have ended
        self._heard: RawFrame | None = None  # that `_open` became whole with
        self._complete: tuple[bytes, RawFrame] | None = None  # the next one decides of it
        self._before: int | None = None  # ticks of the last one that counted
        self._spacings: deque[int] = deque([max(delay, 1)] * 4, maxlen=PACE_PACKETS)

    @property
    def pace_ticks(self) -> float:
        """From packet to packet: of the last ones, those that follow a loss apart."""
        shortest = sorted(self._spacings)[: -(-3 * len(self._spacings) // 4)]
        return sum(shortest) / len(shortest)

    def push(self, frame: RawFrame) -> list[Streamed]:
        """What the bytes of *frame* prove to be packets."""
        proven = []
        for byte in frame.data:
            if byte & MARK:
                self._close()
                self._open, self._heard = bytes([byte]), None
            elif self._open and len(self._open) < LONGEST:
                self._open += bytes([byte])
            else:
                continue
            if len(self._open) == self._size:
                self._heard = frame
            if len(self._open) == _TIMER_AT + 2 and self._complete is not None:
                proven += self._judge(*self._complete)
                self._complete = None
        return proven

    def _close(self) -> None:
        """Another beginning: what was open is a packet, or none."""
        if len(self._open) < _TIMER_AT + 2:
            self._complete = None  # nothing tells of the one before
        good = len(self._open) == self._size and self._open[0] == self._head
        if good and self._heard is not None:
            self._complete = self._open, self._heard
            self.packets += 1
        else:
            self._complete = None
            self.malformed += bool(self._open)

    def _judge(self, packet: bytes, heard: RawFrame) -> list[Streamed]:
        ticks = _timer(packet)
        spacing = (_timer(self._open) - ticks) % TICKS
        pace = self.pace_ticks
        if 0 < spacing < TICKS // 2:
            self._spacings.append(spacing)
        if self._open[0] != self._head or not 0 < spacing <= NEXT * pace:
            self.malformed += 1
            return []
        lost = None
        if self._before is not None:
            lost = max(0, int((ticks - self._before) % TICKS / pace + 2 - NEXT) - 1)
        self._before = ticks
        return [Streamed(packet, heard, ticks, lost)]

    # --- for a recording that begins in the middle ------------------------------------------

    def state(self) -> list[Any]:
        """For `restored`, as JSON."""
        complete = self._complete and [self._complete[0].hex(), *_time(self._complete[1])]
        heard = self._heard and _time(self._heard)
        return [
            self.request.hex(),
            self._open.hex(),
            heard,
            complete,
            self._before,
            [*self._spacings],
        ]

    @classmethod
    def restored(cls, state: list[Any]) -> PacketStream:
        request, opened, heard, complete, before, spacings = state
        stream = cls(bytes.fromhex(request))
        stream._open = bytes.fromhex(opened)
        stream._heard = heard and _frame(*heard)
        stream._complete = complete and (bytes.fromhex(complete[0]), _frame(*complete[1:]))
        stream._before = before
        stream._spacings = deque(spacings, maxlen=PACE_PACKETS)
        return stream


def _timer(packet: bytes) -> int:
    return packet[_TIMER_AT] << 7 | packet[_TIMER_AT + 1]


def _time(frame: RawFrame) -> list[int]:
    return [frame.monotonic_ns, frame.unix_ns]


def _frame(monotonic_ns: int, unix_ns: int) -> RawFrame:
    return RawFrame(monotonic_ns, unix_ns, "rx", b"")

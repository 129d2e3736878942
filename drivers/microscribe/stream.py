"""Finds the packets that the arm sends by itself, and counts lost ones.

The wire has no checksum and no packet number. So a packet counts only if it fits exactly between
two head bytes and the next packet's timer fits the pace. A lost, inserted or changed piece of the
line costs the packets that it touched, and creates none.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

from armd.drivers.microscribe.wire import MARK, TICKS, get_standard_size, parse_streamed_command
from armd.drivers.sample import RawFrame

PACE_PACKETS = 16  # number of packets over which the pace is averaged
NEXT = 1.6  # after more paces than this, a packet is not the next one
_TIMER_AT = 2  # in a packet: after the head byte and the buttons
LONGEST = 64  # the most bytes kept after a head byte


class Streamed(NamedTuple):
    packet: bytes
    heard: RawFrame  # the frame of its last byte
    ticks: int  # of 14 bits
    lost: int | None  # packets between it and the one before; None: it is the first


class PacketStream:
    """The packets of one command to stream, *request*."""

    def __init__(self, request: bytes) -> None:
        command, delay = parse_streamed_command(request)
        self.request = request
        self.malformed = 0
        self.packets = 0  # number of complete packets
        self._head = command | MARK
        self._size = get_standard_size(command)
        self._open = b""  # the packet that may be incomplete
        self._heard: RawFrame | None = None  # the frame that completed `_open`
        self._complete: tuple[bytes, RawFrame] | None = None  # confirmed by the next one
        self._before: int | None = None  # ticks of the last accepted one
        self._spacings: deque[int] = deque([max(delay, 1)] * 4, maxlen=PACE_PACKETS)

    @property
    def pace_ticks(self) -> float:
        """The mean interval of packets, without the longest quarter, which may follow losses."""
        shortest = sorted(self._spacings)[: -(-3 * len(self._spacings) // 4)]
        return sum(shortest) / len(shortest)

    def push(self, frame: RawFrame) -> list[Streamed]:
        """Take the bytes of *frame*; return the packets that they confirm."""
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
        """Close the open packet at the next head byte; keep it only if it is complete."""
        if len(self._open) < _TIMER_AT + 2:
            self._complete = None  # nothing confirms the one before
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
        """Return the state for `restored`, as JSON."""
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

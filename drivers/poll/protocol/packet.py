"""What both servo protocols have in common: packets, and how they are found among other bytes."""

from __future__ import annotations

from collections.abc import Callable, Container
from enum import Enum
from typing import NamedTuple

BROADCAST = 0xFE


class Packet(NamedTuple):
    """One intact packet: from the host, or a servo's status."""

    id: int
    code: int  # the instruction; in a Feetech status its error byte, in a Dynamixel one STATUS
    params: bytes  # without stuffing
    raw: bytes  # as it crossed the wire


class Status(NamedTuple):
    """What one servo answered."""

    id: int
    error: int
    data: bytes


class ReadRequest(NamedTuple):
    """What the host asks for: *length* bytes from *address* on, of each of *ids* in this order."""

    ids: tuple[int, ...]
    address: int
    length: int
    fast: bool = False  # all answers in one packet (Dynamixel's Fast Sync Read)
    is_single: bool = False  # a plain read of one servo


class Cut(Enum):
    """Why no packet begins at a header's place."""

    INCOMPLETE = "more bytes are wanted"
    NO_HEADER = "these bytes only look like a header"
    BAD_SUM = "the checksum does not hold"


class Splitter:
    """Finds packets in a stream of bytes; feed it whatever came.

    *cut* takes the bytes, a header's place and the sizes of packets that are believed. Nothing but
    a whole packet whose checksum holds is taken out of the stream: what follows a damaged one is
    found wherever it begins, also within what the damaged one claimed.
    """

    def __init__(
        self,
        header: bytes,
        cut: Callable[[bytearray, int, Container[int]], Packet | Cut],
        sizes: Container[int],
    ) -> None:
        self._header = header
        self._cut = cut
        self._buffer = bytearray()
        #: bytes a whole packet may have; a header that claims another number is none
        self.sizes = sizes
        self.junk = 0  # bytes that belonged to no packet
        self.bad_sum = 0  # packets whose checksum did not hold

    def push(self, data: bytes) -> list[Packet]:
        """The packets that *data* completes, in order."""
        self._buffer += data
        return self._scan(wait=True)

    def flush(self) -> list[Packet]:
        """Nothing more comes: what hides behind headers that wait for more; then start afresh."""
        packets = self._scan(wait=False) if self._buffer else []
        self.junk += len(self._buffer)
        self._buffer.clear()
        return packets

    def _scan(self, wait: bool) -> list[Packet]:
        buffer, packets, position = self._buffer, [], 0
        while (begin := buffer.find(self._header, position)) >= 0:
            self.junk += begin - position
            position = begin
            cut = self._cut(buffer, position, self.sizes)
            if isinstance(cut, Packet):
                packets.append(cut)
                position += len(cut.raw)
                continue
            if cut is Cut.INCOMPLETE and wait:
                break
            self.bad_sum += cut is Cut.BAD_SUM
            self.junk += 1
            position += 1
        else:  # the end may be the beginning of a header
            n_kept = min(len(self._header) - 1, len(buffer) - position)
            while n_kept and not self._header.startswith(buffer[len(buffer) - n_kept :]):
                n_kept -= 1
            self.junk += len(buffer) - n_kept - position
            position = len(buffer) - n_kept
        del buffer[:position]
        return packets

"""The common part of both servo protocols: packets, and the search for them in a stream."""

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
    raw: bytes  # the bytes on the wire


class Status(NamedTuple):
    """The answer of one servo."""

    id: int
    error: int
    data: bytes


class ReadRequest(NamedTuple):
    """A read of *length* bytes from *address* on, of each of *ids* in this order."""

    ids: tuple[int, ...]
    address: int
    length: int
    fast: bool = False  # all answers in one packet (Dynamixel's Fast Sync Read)
    is_single: bool = False  # a plain read of one servo


class Cut(Enum):
    """The reasons why no packet begins at a header."""

    INCOMPLETE = "more bytes are wanted"
    NO_HEADER = "these bytes only look like a header"
    BAD_SUM = "the checksum does not hold"


class Splitter:
    """Finds packets in a stream of bytes.

    *cut* takes the bytes, the position of a header and the permitted packet sizes. Only complete
    packets with a correct checksum are taken out of the stream. So a packet after a damaged one is
    found wherever it begins, even within the length that the damaged one claimed.
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
        #: permitted sizes of a packet; a header that claims another size is none
        self.sizes = sizes
        self.junk = 0  # bytes that belonged to no packet
        self.bad_sum = 0  # packets with a wrong checksum

    def push(self, data: bytes) -> list[Packet]:
        """Take *data*; return the packets that it completes, in order."""
        self._buffer += data
        return self._scan(wait=True)

    def flush(self) -> list[Packet]:
        """Return the packets behind incomplete headers, as no more bytes come; then start again."""
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

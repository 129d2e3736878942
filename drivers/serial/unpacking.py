"""SAMPLEs and nothing else, which is what mostly comes: from the line's bytes to rows, compiled.

The rule is `wire`'s, written once more for a loop over bytes; tests hold the two together.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np

from armd.compiled.jit import jit
from armd.drivers.serial.wire import CRC_RESIDUE, Type, make_row_layout

#: Bytes that COBS and the final 0x00 add to a SAMPLE, whose bytes are fewer than 254.
FRAMING = 2
#: Packets of one read for which there is room; of more, `wire` takes care.
ROOM = 256
#: Of CRC-32, by a byte.
_TABLE = np.array([zlib.crc32(bytes([k]), 0xFFFFFFFF) ^ 0xFFFFFFFF for k in range(256)], np.uint32)
_ALL_ONES, _RESIDUE = np.uint32(0xFFFFFFFF), np.uint32(CRC_RESIDUE)
_EIGHT = np.uint32(8)
_SAMPLE = int(Type.SAMPLE)


class SampleBytes:
    """A read's bytes and the rows that they hold, in memory that compiled functions share."""

    def __init__(self, n_joints: int) -> None:
        layout = make_row_layout(n_joints)
        self.packet_bytes = layout.itemsize + FRAMING
        room = bytearray(ROOM * self.packet_bytes)
        self._view = memoryview(room)
        self.packets = np.frombuffer(room, np.uint8).reshape(ROOM, self.packet_bytes)
        self.rows = np.zeros(ROOM, layout)
        self.row_bytes = self.rows.view(np.uint8).reshape(ROOM, layout.itemsize)

    def put(self, data: bytes) -> int:
        """How many SAMPLEs *data* holds if it holds nothing else; 0: something else, or none."""
        n, rest = divmod(len(data), self.packet_bytes)
        if rest or n > ROOM:
            return 0
        self._view[: len(data)] = data
        return n


@jit
def unpack_samples(n: int, packets: Any, row_bytes: Any) -> bool:
    """Fill the first *n* rows, as bytes (≥ n, R), from *packets* (≥ n, R + 2); whether each is a
    SAMPLE of its length, number of joints and CRC, its time no nonsense."""
    length = row_bytes.shape[1]
    joints = (length - 20) // 4
    for i in range(n):
        packet, row = packets[i], row_bytes[i]
        if packet[length + 1] != 0:
            return False
        end = np.int64(0)  # of the present group of COBS
        for k in range(length + 1):
            byte = packet[k]
            if byte == 0:
                return False
            if k == end:
                end += np.int64(byte)
                if k > 0:
                    row[k - 1] = 0
            else:
                row[k - 1] = byte
        if end != length + 1:
            return False
        crc = _ALL_ONES
        for k in range(length):
            crc = _TABLE[(crc ^ np.uint32(row[k])) & 0xFF] ^ (crc >> _EIGHT)
        if crc ^ _ALL_ONES != _RESIDUE:
            return False
        if row[0] != _SAMPLE or row[3] != joints or row[15] != 0 or row[14] >= 32:
            return False
    return True

"""Unpacks a read that holds only SAMPLEs, the usual case, to rows; compiled.

The rule is that of `wire`, repeated for a loop over bytes; tests compare the two.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np

from armd.compiled.jit import jit
from armd.drivers.serial.wire import CRC_RESIDUE, Type, make_row_layout

#: Bytes that COBS and the final 0x00 add to a SAMPLE of fewer than 254 bytes.
FRAMING = 2
#: The most packets of one read; `wire` decodes larger reads.
ROOM = 256
#: The table of CRC-32, by byte.
_TABLE = np.array([zlib.crc32(bytes([k]), 0xFFFFFFFF) ^ 0xFFFFFFFF for k in range(256)], np.uint32)
_ALL_ONES, _RESIDUE = np.uint32(0xFFFFFFFF), np.uint32(CRC_RESIDUE)
_EIGHT = np.uint32(8)
_SAMPLE = int(Type.SAMPLE)


class SampleBytes:
    """The bytes of one read and their rows, in memory that compiled functions share."""

    def __init__(self, n_joints: int) -> None:
        layout = make_row_layout(n_joints)
        self.packet_bytes = layout.itemsize + FRAMING
        room = bytearray(ROOM * self.packet_bytes)
        self._view = memoryview(room)
        self.packets = np.frombuffer(room, np.uint8).reshape(ROOM, self.packet_bytes)
        self.rows = np.zeros(ROOM, layout)
        self.row_bytes = self.rows.view(np.uint8).reshape(ROOM, layout.itemsize)

    def put(self, data: bytes) -> int:
        """Store *data*; return the number of its SAMPLEs, or 0 if it cannot be SAMPLEs only."""
        n, rest = divmod(len(data), self.packet_bytes)
        if rest or n > ROOM:
            return 0
        self._view[: len(data)] = data
        return n


@jit
def unpack_samples(n: int, packets: Any, row_bytes: Any) -> bool:
    """Fill the first *n* rows, as bytes (≥ n, R), from *packets* (≥ n, R + 2).

    Returns whether each is a SAMPLE with the right length, number of joints and CRC, and a valid
    time.
    """
    length = row_bytes.shape[1]
    joints = (length - 20) // 4
    for i in range(n):
        packet, row = packets[i], row_bytes[i]
        if packet[length + 1] != 0:
            return False
        end = np.int64(0)  # end of the present group of COBS
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

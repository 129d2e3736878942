"""Encodes raw frames for a recorder: a small header, then the bytes that crossed the wire.

`armd/<serial>/@raw`: i64 number of the frame (without gaps unless one was lost) · i64 monotonic_ns
· i64 unix_ns · u8 direction (0 rx, 1 tx, 2 link) · u8 length of channel · channel · the bytes.
Little-endian.
"""

from __future__ import annotations

import struct
from typing import Literal

from armd.drivers.sample import RawFrame

_HEADER = struct.Struct("<qqqBB")
_DIRECTIONS: tuple[Literal["rx", "tx", "link"], ...] = ("rx", "tx", "link")


def pack(number: int, frame: RawFrame) -> bytes:
    """Encode a frame as it is published."""
    channel = frame.channel.encode()
    direction = _DIRECTIONS.index(frame.direction)
    header = _HEADER.pack(number, frame.monotonic_ns, frame.unix_ns, direction, len(channel))
    return header + channel + frame.data


def unpack(payload: bytes) -> tuple[int, RawFrame]:
    """Decode number and frame of a published payload; raises ValueError for an invalid one."""
    if len(payload) < _HEADER.size:
        raise ValueError(f"{len(payload)} bytes, fewer than its header has")
    number, monotonic_ns, unix_ns, direction, length = _HEADER.unpack_from(payload)
    data_at = _HEADER.size + length
    if direction >= len(_DIRECTIONS) or data_at > len(payload):
        raise ValueError(f"direction {direction}, {length} bytes of channel")
    if unix_ns < 0:
        raise ValueError(f"a time of {unix_ns} ns")
    return number, RawFrame(
        monotonic_ns,
        unix_ns,
        _DIRECTIONS[direction],
        payload[data_at:],
        payload[_HEADER.size : data_at].decode(),
    )

"""Dynamixel's protocol 1.0, in pure functions; Feetech's packets are the same.

`FF FF | id | length | instruction or error | parameters | checksum`. There is no sync read; only
the MX series knows a bulk read. Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 1.0".
"""

from __future__ import annotations

from collections.abc import Sequence

from armd.drivers.poll.protocol.feetech import (
    PING,
    READ,
    WRITE,
    are_statuses,
    compute_status_size,
    decode_statuses,
    make_packet,
    make_ping,
    make_read,
    make_splitter,
    make_status,
    make_write,
)
from armd.drivers.poll.protocol.feetech import decode_read_request as _plain_request
from armd.drivers.poll.protocol.packet import BROADCAST, Packet, ReadRequest

__all__ = [
    "PING",
    "READ",
    "WRITE",
    "are_statuses",
    "compute_status_size",
    "decode_statuses",
    "make_packet",
    "make_ping",
    "make_read",
    "make_splitter",
    "make_status",
    "make_write",
]

SYNC_WRITE, BULK_READ = 0x83, 0x92

#: bit of a status's error byte → the servo's fault; its data are valid
ERRORS = {0: "input voltage", 1: "angle limit", 2: "overheating", 5: "overload"}
#: bits of a refused request: range, checksum, instruction
REFUSALS = 1 << 3 | 1 << 4 | 1 << 6


def make_bulk_read(parts: Sequence[tuple[int, int, int]]) -> bytes:
    """Make a read of (id, address, length), which each answers with a status, in this order."""
    triples = [bytes([length, servo, address]) for servo, address, length in parts]
    return make_packet(BROADCAST, BULK_READ, b"\0" + b"".join(triples))


def decode_read_request(packet: Packet) -> ReadRequest | None:
    """Decode a packet as the host's; None if it asks for no registers, or for several spans."""
    if packet.code == BULK_READ and len(packet.params) > 3 and len(packet.params) % 3 == 1:
        lengths, ids, addresses = (packet.params[k::3] for k in (1, 2, 3))
        if len(set(lengths)) == len(set(addresses)) == 1:
            return ReadRequest(tuple(ids), addresses[0], lengths[0])
        return None
    return _plain_request(packet) if packet.code == READ else None

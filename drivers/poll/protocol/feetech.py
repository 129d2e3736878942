"""Feetech's protocol for STS and SMS servos (little-endian), in pure functions.

`FF FF | id | length | instruction or error | parameters | checksum`; length counts the bytes that
follow it. There is no stuffing: FF FF occurs within packets. Sources: the maker's protocol manual
and memory table of the STS3215; bit 15 of a position is its sign, the rest its magnitude.
"""

from __future__ import annotations

from collections.abc import Container, Sequence

from armd.drivers.poll.protocol.packet import BROADCAST, Cut, Packet, ReadRequest, Splitter, Status

HEADER = b"\xff\xff"
#: size of header, id, length, code and checksum: every packet without its parameters
OVERHEAD = 6

PING, READ, WRITE, REG_WRITE, ACTION = 0x01, 0x02, 0x03, 0x04, 0x05
SYNC_READ, SYNC_WRITE = 0x82, 0x83

#: bit of a status's error byte → the servo's fault; its data are valid
ERRORS = {0: "voltage", 1: "encoder", 2: "temperature", 3: "current", 5: "overload"}


def make_packet(servo_id: int, code: int, params: bytes = b"") -> bytes:
    """Make a complete packet: an instruction to a servo, or a status with error byte *code*."""
    body = bytes([servo_id, len(params) + 2, code]) + params
    return HEADER + body + bytes([~sum(body) & 0xFF])


def make_ping(servo_id: int) -> bytes:
    """Make a ping. Beware of adapters that echo: the echo looks like a status with a "voltage"
    error.
    """
    return make_packet(servo_id, PING)


def make_read(servo_id: int, address: int, length: int) -> bytes:
    """Make a read. Beware of adapters that echo: the echo of a read of 2 bytes looks like its
    answer.
    """
    return make_packet(servo_id, READ, bytes([address, length]))


def make_write(servo_id: int, address: int, data: bytes) -> bytes:
    return make_packet(servo_id, WRITE, bytes([address]) + data)


def make_sync_read(ids: Sequence[int], address: int, length: int) -> bytes:
    """Make a request to which each of *ids* answers with its own status, in this order."""
    return make_packet(BROADCAST, SYNC_READ, bytes([address, length, *ids]))


def make_status(servo_id: int, error: int, data: bytes = b"") -> bytes:
    """Make a status as a servo sends it."""
    return make_packet(servo_id, error, data)


def compute_status_size(length: int) -> int:
    """Return the bytes on the wire of a status with *length* bytes of data."""
    return OVERHEAD + length


def are_statuses(data: bytes, ids: Sequence[int], length: int) -> bool:
    """Return whether *data* are complete intact statuses of *ids*, with *length* bytes of data
    each.
    """
    size = compute_status_size(length)
    if len(data) != size * len(ids):
        return False
    for i, servo in enumerate(ids):
        status = data[i * size : (i + 1) * size]
        if not status.startswith(HEADER) or status[2] != servo or status[3] != length + 2:
            return False
        if sum(status[2:]) & 0xFF != 0xFF:
            return False
    return True


def make_splitter() -> Splitter:
    """Make a splitter that finds the packets of both sides."""
    return Splitter(HEADER, _cut, range(OVERHEAD, OVERHEAD + 254))


def _cut(buffer: bytearray, begin: int, sizes: Container[int]) -> Packet | Cut:
    if len(buffer) < begin + OVERHEAD:
        return Cut.INCOMPLETE
    servo_id, length = buffer[begin + 2], buffer[begin + 3]
    if servo_id == 0xFF or length + 4 not in sizes:
        return Cut.NO_HEADER
    end = begin + 4 + length
    if len(buffer) < end:
        return Cut.INCOMPLETE
    if sum(buffer[begin + 2 : end]) & 0xFF != 0xFF:
        return Cut.BAD_SUM
    raw = bytes(buffer[begin:end])
    return Packet(servo_id, raw[4], raw[5:-1], raw)


def decode_statuses(packet: Packet) -> list[Status]:
    """Decode a packet as a servo's status; an instruction's echo decodes as a status too."""
    return [] if packet.id == BROADCAST else [Status(packet.id, packet.code, packet.params)]


def decode_read_request(packet: Packet) -> ReadRequest | None:
    """Decode a packet as the host's; None if it asks for no registers."""
    params = packet.params
    if packet.code == READ and len(params) == 2:
        return ReadRequest((packet.id,), params[0], params[1], is_single=True)
    if packet.code == SYNC_READ and len(params) > 2:
        return ReadRequest(tuple(params[2:]), params[0], params[1])
    return None


def decode_signed(value: int, sign_bit: int) -> int:
    """Decode Feetech's sign and magnitude, with the sign in *sign_bit*."""
    magnitude = value & ((1 << sign_bit) - 1)
    return -magnitude if value >> sign_bit & 1 else magnitude

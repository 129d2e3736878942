"""Dynamixel's protocol 2.0, in pure functions.

`FF FF FD 00 | id | length (2) | instruction | parameters | CRC (2)`, little-endian; length counts
the bytes that follow it. Within instruction and parameters FF FF FD is stuffed to FF FF FD FD;
length and CRC count the stuffed form. Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0".
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence

from fastcrc import crc16

from armd.drivers.poll.protocol.packet import BROADCAST, Cut, Packet, ReadRequest, Splitter, Status

HEADER = b"\xff\xff\xfd\x00"
#: size of header, id, length, instruction and CRC: every packet without its parameters
OVERHEAD = 10
_FAST_HEAD = 8  # bytes before the first servo's block of a fast status
_LONGEST = 1024

PING, READ, WRITE, REG_WRITE, ACTION, REBOOT = 0x01, 0x02, 0x03, 0x04, 0x05, 0x08
STATUS = 0x55
SYNC_READ, SYNC_WRITE, FAST_SYNC_READ, BULK_READ = 0x82, 0x83, 0x8A, 0x92

ALERT = 0x80  # bit of a status's error byte: register 70 has the reason; the data are valid
#: bit of register 70 → the servo's fault
HARDWARE_ERRORS = {
    0: "input voltage",
    2: "overheating",
    3: "motor encoder",
    4: "electrical shock",
    5: "overload",
}


#: CRC-16 with polynomial 0x8005, from 0, neither reflected nor inverted; continues from a second
#: argument.
_crc = crc16.umts


def make_packet(servo_id: int, instruction: int, params: bytes = b"") -> bytes:
    """Make a complete packet, stuffed."""
    body = (bytes([instruction]) + params).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    packet = HEADER + bytes([servo_id]) + (len(body) + 2).to_bytes(2, "little") + body
    return packet + _crc(packet).to_bytes(2, "little")


def make_ping(servo_id: int) -> bytes:
    return make_packet(servo_id, PING)


def make_read(servo_id: int, address: int, length: int) -> bytes:
    return make_packet(servo_id, READ, _span(address, length))


def make_write(servo_id: int, address: int, data: bytes) -> bytes:
    return make_packet(servo_id, WRITE, address.to_bytes(2, "little") + data)


def make_sync_read(ids: Sequence[int], address: int, length: int) -> bytes:
    """Make a request to which each of *ids* answers with its own status, in this order."""
    return make_packet(BROADCAST, SYNC_READ, _span(address, length) + bytes(ids))


def make_fast_sync_read(ids: Sequence[int], address: int, length: int) -> bytes:
    """Make a request that all *ids* answer in one status; a missing one ends it."""
    return make_packet(BROADCAST, FAST_SYNC_READ, _span(address, length) + bytes(ids))


def make_status(servo_id: int, error: int, data: bytes = b"") -> bytes:
    """Make a status as a servo sends it."""
    return make_packet(servo_id, STATUS, bytes([error]) + data)


def compute_status_size(length: int) -> int:
    """Return the bytes on the wire of a status with *length* bytes of data without stuffing."""
    return OVERHEAD + 1 + length


def make_fast_status_blocks(
    answers: Sequence[Status], carry: Callable[[int, bytes], bytes] = lambda _, block: block
) -> list[bytes]:
    """Make the pieces of one fast status, as the servos send them in turn; not stuffed.

    *carry* (servo, its block) gives the block as the line carries it, to host and later servos.
    """
    length = 1 + sum(4 + len(answer.data) for answer in answers)
    head = HEADER + bytes([BROADCAST]) + length.to_bytes(2, "little") + bytes([STATUS])
    blocks, crc = [], 0
    for i, answer in enumerate(answers):
        block = (b"" if i else head) + bytes([answer.error, answer.id]) + answer.data
        check = _crc(block, crc).to_bytes(2, "little")
        blocks.append(carry(answer.id, block) + check)
        crc = _crc(blocks[-1], crc)
    return blocks


def compute_fast_status_size(n: int, length: int) -> int:
    """Return the bytes on the wire of a fast status of *n* servos with *length* bytes each."""
    return OVERHEAD - 2 + n * (4 + length)


def is_fast_status(data: bytes, n: int, length: int) -> bool:
    """Return whether *data* are one complete fast status of that size with all answers intact."""
    return (
        len(data) == compute_fast_status_size(n, length)
        and data.startswith(HEADER)
        and data[4] == BROADCAST
        and data[7] == STATUS
        and all(_intact_blocks(data, length))
    )


def _intact_blocks(raw: bytes, length: int) -> list[bool]:
    """Return which servos' checksums in a fast status are correct.

    Each checksum covers all bytes from the packet's header on, as its servo received them. A servo
    includes the others' checksums without checking them.
    """
    intact, crc, begin = [], 0, 0
    for end in range(_FAST_HEAD + 2 + length, len(raw), 4 + length):
        crc = _crc(raw[begin:end], crc)
        intact.append(crc == raw[end] | raw[end + 1] << 8)
        crc, begin = _crc(raw[end : end + 2], crc), end + 2
    return intact


def make_splitter() -> Splitter:
    """Make a splitter that finds the packets of both sides."""
    return Splitter(HEADER, _cut, range(OVERHEAD, _LONGEST))


def _cut(buffer: bytearray, begin: int, sizes: Container[int]) -> Packet | Cut:
    if len(buffer) < begin + OVERHEAD:
        return Cut.INCOMPLETE
    servo_id, length = buffer[begin + 4], buffer[begin + 5] | buffer[begin + 6] << 8
    if servo_id == 0xFF or length + 7 not in sizes:
        return Cut.NO_HEADER
    end = begin + 7 + length
    if len(buffer) < end:
        return Cut.INCOMPLETE
    raw = bytes(buffer[begin:end])
    if _crc(raw[:-2]) != raw[-2] | raw[-1] << 8:
        return Cut.BAD_SUM
    body = raw[7:-2]
    if not (servo_id == BROADCAST and body[0] == STATUS):  # a fast status is never stuffed
        body = body.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
    return Packet(servo_id, body[0], body[1:], raw)


def decode_statuses(packet: Packet, length: int | None = None) -> list[Status]:
    """Decode a packet as servos' answers.

    A fast status can be split only if the *length* of the requested data is known; servos whose own
    checksums are wrong are missing in the result.
    """
    if packet.code != STATUS or not packet.params:
        return []
    if packet.id != BROADCAST:
        return [Status(packet.id, packet.params[0], packet.params[1:])]
    if length is None or (len(packet.params) + 2) % (4 + length):
        return []
    blocks = range(0, len(packet.params), 4 + length)
    params, intact = packet.params, _intact_blocks(packet.raw, length)
    return [
        Status(params[i + 1], params[i], params[i + 2 : i + 2 + length])
        for i, holds in zip(blocks, intact, strict=True)
        if holds
    ]


def decode_read_request(packet: Packet) -> ReadRequest | None:
    """Decode a packet as the host's; None if it asks for no registers."""
    params = packet.params
    if len(params) < 4:
        return None
    address, length = params[0] | params[1] << 8, params[2] | params[3] << 8
    match packet.code:
        case 0x02:  # READ
            return ReadRequest((packet.id,), address, length, is_single=True)
        case 0x82 | 0x8A:  # SYNC_READ, FAST_SYNC_READ
            fast = packet.code == FAST_SYNC_READ
            return ReadRequest(tuple(params[4:]), address, length, fast)
    return None


def _span(address: int, length: int) -> bytes:
    return address.to_bytes(2, "little") + length.to_bytes(2, "little")

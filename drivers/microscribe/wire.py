"""The MicroScribe's wire, in pure functions.

The host sends one command byte; the reply begins with the same byte, bit 7 set. In a standard reply
no other byte has bit 7, so its beginning is always found; configuration replies hold plain 8-bit
numbers, most significant byte first. There is no checksum. After the command "respond to motion",
the arm sends standard replies by itself until the next command. Source: the maker's SDK manual.
"""

from __future__ import annotations

from typing import NamedTuple

#: The arm's rates, likely ones first; it keeps the rate at which it receives IMMC.
BAUDS = (115_200, 57_600, 38_400, 19_200, 9_600, 28_800, 14_400)
SYNC, BEGIN, GREETING = b"IMMC", b"BEGIN", b"MSCR"

PARAMETERS, HOME, END, MAXIMA = 0xC0, 0xC2, 0xC5, 0xC6
PRODUCT, MODEL, SERIAL_NUMBER, COMMENT, FORMAT, FIRMWARE = 0xC8, 0xCA, 0xCB, 0xCC, 0xCD, 0xCE
EXTENDED = 0xD3
RESPOND_TO_MOTION = 0xCF
#: Ends streaming, as any command does. It requests a standard reply without fields, as the maker's
#: library does. The reply has two bytes, unlike any packet under way.
STOP = b"\0"

#: Standard commands: time and angles 0-4, which is all that is needed. If an arm does not answer:
#: with angle 5 as well, then without time.
POLLS = (0x21, 0x23, 0x03)
N_JOINTS = 5
TIME = 0x20  # the bit that asks for the timer
TICKS = 1 << 14  # the timer's period
MARK = 0x80  # the bit that only a packet's first byte has
_CONTROLLERS = (0, 2, 4, 8)  # by bits 3 and 2
_ANGLES = (0, 5, 7, 6)  # by bits 1 and 0
_ANGLES_AT = 12  # in the reply to MAXIMA: after buttons, time, eight controllers and their odd bits
_MAXIMA_BYTES = 24
_CHANGES = 1 + 8 + 2 * 6  # the changes that cause a reply: buttons, eight controllers, six angles


class StandardReply(NamedTuple):
    """A decoded standard reply."""

    buttons: int  # bit 0: the single or right pedal, bit 1: the left one
    ticks: int | None  # of 1/900 s, modulo 2^14
    counts: tuple[int, ...]  # continue past a turn; modulo 2^14


def get_standard_size(command: int) -> int:
    """Return the number of bytes in the reply to a standard command."""
    controllers = _CONTROLLERS[command >> 2 & 3]
    extra = controllers + 1 if controllers else 0
    return 2 + (2 if command & TIME else 0) + extra + 2 * _ANGLES[command & 3]


def encode_standard(command: int, reading: StandardReply) -> bytes:
    """Encode a standard reply as the arm does; requested controllers read zero."""
    controllers = _CONTROLLERS[command >> 2 & 3]
    data = bytearray([command | 0x80, reading.buttons & 0x7F])
    if command & TIME:
        data += _seven(reading.ticks or 0)
    data += bytes(controllers + 1 if controllers else 0)
    counts = [*reading.counts, 0, 0][: _ANGLES[command & 3]]
    return bytes(data) + b"".join(_seven(count) for count in counts)


def decode_standard(packet: bytes) -> StandardReply:
    """Decode a complete standard reply, as `take` cuts it."""
    command = packet[0]
    n = _ANGLES[command & 3]
    angles = packet[-2 * n :]
    words = [high << 7 | low for high, low in zip(angles[::2], angles[1::2], strict=True)]
    ticks = packet[2] << 7 | packet[3] if command & TIME else None
    return StandardReply(packet[1], ticks, tuple(words))


def start_streaming(command: int, delay_ticks: int) -> bytes:
    """Encode RESPOND_TO_MOTION: the arm answers *command* every *delay_ticks*, even at rest.

    With all changes zero, only the delay sets the pace. An arm that does not know this command
    reads the following bytes as commands. All of them are below 0x40, so they only request
    readings. Raises `ValueError` if an argument does not permit that.
    """
    if not 0 < delay_ticks < 0x40 or command >= 0x40:
        raise ValueError(f"delay {delay_ticks}, command {command:#x}: 1 to 63 ticks, below 0x40")
    head = bytes([RESPOND_TO_MOTION]) + delay_ticks.to_bytes(2, "big") + bytes([command])
    return head + bytes(_CHANGES)


def parse_streamed_command(request: bytes) -> tuple[int, int]:
    """Return the command that a RESPOND_TO_MOTION repeats, and its delay in ticks."""
    return request[3] & 0x7F, int.from_bytes(request[1:3], "big")


def compute_delay_ticks(command: int, baud: int) -> int:
    """Return the shortest delay in ticks in which a reply passes the line; at least 2.

    A tick counts as 1 ms here, a little less than it is.
    """
    return max(2, 1 + get_standard_size(command) * 10_000 // baud)


def take(command: int, buffer: bytes, complete: bool = False) -> tuple[bytes | None, bytes]:
    """Take the reply to *command* out of *buffer*; return it and the bytes behind it.

    None if it is not complete. *complete*: nothing more comes, so a text may lack its closing zero.
    """
    begin = 0
    while (begin := buffer.find(command | 0x80, begin)) >= 0:
        size = _size(command, buffer[begin:], complete)
        if size is None or begin + size > len(buffer):
            return None, buffer[begin:]
        packet = buffer[begin : begin + size]
        if command & 0x40 or not any(byte & 0x80 for byte in packet[1:]):
            return packet, buffer[begin + size :]
        begin += 1
    return None, b""


def _size(command: int, packet: bytes, complete: bool) -> int | None:
    """Return the bytes of the reply that begins *packet*; None if that is not known yet."""
    command |= 0x80 if command & 0x40 else 0
    match command:
        case 0xC0 | 0xD3:  # PARAMETERS, EXTENDED: a number of bytes, and the bytes
            return packet[1] + 2 if len(packet) > 1 else None
        case 0xC6:  # MAXIMA
            return 1 + _MAXIMA_BYTES
        case 0xC8 | 0xC9 | 0xCA | 0xCB | 0xCC | 0xCD | 0xCE:  # texts
            end = packet.find(b"\0")
            return end + 1 if end >= 0 else len(packet) if complete and len(packet) > 1 else None
        case _:
            return 1 if command & 0x40 else get_standard_size(command)


def decode_text(packet: bytes) -> str:
    """Decode the reply to one of the text commands."""
    return packet[1:].rstrip(b"\0").decode("ascii", "replace").strip()


def decode_counts_per_turn(maxima: bytes) -> tuple[int, ...]:
    """Decode the counts per turn of the five joints from the reply to MAXIMA."""
    angles = maxima[1 + _ANGLES_AT :]
    return tuple(int.from_bytes(angles[2 * k : 2 * k + 2], "big") + 1 for k in range(N_JOINTS))


def decode_words(packet: bytes) -> tuple[int, ...]:
    """Decode the signed 16-bit numbers of a reply to PARAMETERS or EXTENDED."""
    data = packet[2:]
    return tuple(
        int.from_bytes(data[i : i + 2], "big", signed=True) for i in range(0, len(data) - 1, 2)
    )


def _seven(word: int) -> bytes:
    """Encode fourteen bits in two bytes of seven."""
    return bytes([word >> 7 & 0x7F, word & 0x7F])

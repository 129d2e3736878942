"""The MicroScribe's wire, in pure functions.

The host sends one command byte; the reply begins with the same byte, bit 7 set. In a standard
reply no other byte has bit 7, so its beginning is always found; configuration replies hold plain
8-bit numbers, most significant byte first. There is no checksum. Told to "respond to motion", the
arm sends standard replies by itself until the next command. Source: the maker's SDK manual.
"""

from __future__ import annotations

from typing import NamedTuple

#: What the arm tries, the likely ones first; it stays with what it hears IMMC at.
BAUDS = (115_200, 57_600, 38_400, 19_200, 9_600, 28_800, 14_400)
SYNC, BEGIN, GREETING = b"IMMC", b"BEGIN", b"MSCR"

PARAMETERS, HOME, END, MAXIMA = 0xC0, 0xC2, 0xC5, 0xC6
PRODUCT, MODEL, SERIAL_NUMBER, COMMENT, FORMAT, FIRMWARE = 0xC8, 0xCA, 0xCB, 0xCC, 0xCD, 0xCE
EXTENDED = 0xD3
RESPOND_TO_MOTION = 0xCF
#: Ends streaming, as any command does: a standard reply without a field, as the maker's own library
#: ends it. Two bytes, so that it is told from all that was under way.
STOP = b"\0"

#: Standard commands: time and angles 0-4, which is all; where an arm does not answer that, with
#: angle 5 as well, and without time.
POLLS = (0x21, 0x23, 0x03)
N_JOINTS = 5
TIME = 0x20  # the bit that asks for the timer
TICKS = 1 << 14  # after which the timer begins anew
MARK = 0x80  # the bit of a packet's first byte alone
_CONTROLLERS = (0, 2, 4, 8)  # by bits 3 and 2
_ANGLES = (0, 5, 7, 6)  # by bits 1 and 0
_ANGLES_AT = 12  # in the reply to MAXIMA: after buttons, time, eight controllers and their odd bits
_MAXIMA_BYTES = 24
_CHANGES = 1 + 8 + 2 * 6  # a mask of buttons, eight controllers, six angles: what makes it answer


class StandardReply(NamedTuple):
    """A standard reply."""

    buttons: int  # bit 0: the single or right pedal, bit 1: the left one
    ticks: int | None  # of 1/900 s, modulo 2^14
    counts: tuple[int, ...]  # running on past a turn; modulo 2^14


def get_standard_size(command: int) -> int:
    """Bytes of the reply to a standard command."""
    controllers = _CONTROLLERS[command >> 2 & 3]
    extra = controllers + 1 if controllers else 0
    return 2 + (2 if command & TIME else 0) + extra + 2 * _ANGLES[command & 3]


def encode_standard(command: int, reading: StandardReply) -> bytes:
    """As the arm sends it; controllers, if asked for, read zero."""
    controllers = _CONTROLLERS[command >> 2 & 3]
    data = bytearray([command | 0x80, reading.buttons & 0x7F])
    if command & TIME:
        data += _seven(reading.ticks or 0)
    data += bytes(controllers + 1 if controllers else 0)
    counts = [*reading.counts, 0, 0][: _ANGLES[command & 3]]
    return bytes(data) + b"".join(_seven(count) for count in counts)


def decode_standard(packet: bytes) -> StandardReply:
    """A whole standard reply, as `take` cuts it."""
    command = packet[0]
    n = _ANGLES[command & 3]
    angles = packet[-2 * n :]
    words = [high << 7 | low for high, low in zip(angles[::2], angles[1::2], strict=True)]
    ticks = packet[2] << 7 | packet[3] if command & TIME else None
    return StandardReply(packet[1], ticks, tuple(words))


def start_streaming(command: int, delay_ticks: int) -> bytes:
    """RESPOND_TO_MOTION: the arm answers *command* every *delay_ticks*, whatever it does.

    With all changes zero the delay alone paces it. An arm that does not know this command takes
    what follows it for commands, too; all of them are below 0x40, so they only ask for readings.
    """
    if not 0 < delay_ticks < 0x40 or command >= 0x40:
        raise ValueError(f"delay {delay_ticks}, command {command:#x}: 1 to 63 ticks, below 0x40")
    head = bytes([RESPOND_TO_MOTION]) + delay_ticks.to_bytes(2, "big") + bytes([command])
    return head + bytes(_CHANGES)


def parse_streamed_command(request: bytes) -> tuple[int, int]:
    """The command that a RESPOND_TO_MOTION has the arm answer, and the delay in ticks."""
    return request[3] & 0x7F, int.from_bytes(request[1:3], "big")


def compute_delay_ticks(command: int, baud: int) -> int:
    """The shortest delay in which a reply passes the line, were a tick 1 ms only; 2 at least."""
    return max(2, 1 + get_standard_size(command) * 10_000 // baud)


def take(command: int, buffer: bytes, complete: bool = False) -> tuple[bytes | None, bytes]:
    """The reply to *command* in *buffer*, if it is there as a whole, and the bytes behind it.

    *complete*: nothing more comes, so that a text may lack its closing zero.
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
    """Bytes of the reply that begins *packet*; None: cannot be told yet."""
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
    """What a reply to one of the text commands says."""
    return packet[1:].rstrip(b"\0").decode("ascii", "replace").strip()


def decode_counts_per_turn(maxima: bytes) -> tuple[int, ...]:
    """Of the five joints, from the reply to MAXIMA."""
    angles = maxima[1 + _ANGLES_AT :]
    return tuple(int.from_bytes(angles[2 * k : 2 * k + 2], "big") + 1 for k in range(N_JOINTS))


def decode_words(packet: bytes) -> tuple[int, ...]:
    """Signed 16-bit numbers of a reply to PARAMETERS or EXTENDED."""
    data = packet[2:]
    return tuple(
        int.from_bytes(data[i : i + 2], "big", signed=True) for i in range(0, len(data) - 1, 2)
    )


def _seven(word: int) -> bytes:
    """Fourteen bits in two bytes of seven."""
    return bytes([word >> 7 & 0x7F, word & 0x7F])

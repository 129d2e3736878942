"""The serial wire, version 1: message layouts, encoding, decoding, and cutting into packets.

A packet is ``COBS(body ‖ CRC-32(body)) ‖ 0x00``; ``body[0]`` is the type; integers are
little-endian. The layouts below are numpy dtypes and include the type byte, so that a run of equal
packets is one `numpy.frombuffer`. Nothing here uses time, ports or the meaning of joints.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import numpy as np
import numpy.typing as npt
from cobs import cobs

from armd.arrays import F64

PROTOCOL = 1
SERIAL_NUMBER_BYTES = 16
PACKET_LIMIT = 4096  # a longer sequence without 0x00 is junk
TEMPERATURE_UNIT_C = 0.01
T_US_LIMIT = 1 << 53  # 285 years: a later time is invalid, and overflows in nanoseconds
CHANNELS_MAX = 16  # width of TEMPERATURE's valid mask

#: CRC-32 of any message followed by its own CRC-32: one call checks a packet without slicing.
CRC_RESIDUE = 0x2144DF1C


class Type(IntEnum):
    SAMPLE = 0x01
    TEMPERATURE = 0x02
    HELLO = 0x03
    PONG = 0x04
    IDENTIFY = 0x81
    PING = 0x82


@cache
def make_sample_layout(n_joints: int) -> np.dtype[np.void]:
    return np.dtype(
        [
            ("type", "u1"),
            ("joint_status", "u1"),  # bit k-1: joint k invalid
            ("buttons", "u1"),
            ("n", "u1"),
            ("seq", "<u4"),
            ("t_us", "<u8"),  # latch instant, device clock since boot
            ("count", "<u4", (n_joints,)),
        ]
    )


@cache
def make_row_layout(n_joints: int) -> np.dtype[np.void]:
    """Return the layout of an unpacked SAMPLE with its CRC."""
    return np.dtype([*make_sample_layout(n_joints).descr, ("crc", "<u4")])


@cache
def make_temperature_layout(n_sensors: int) -> np.dtype[np.void]:
    return np.dtype(
        [
            ("type", "u1"),
            ("n", "u1"),
            ("valid", "<u2"),  # bit i: channel i valid
            ("t_us", "<u8"),
            ("centi_celsius", "<i2", (n_sensors,)),
        ]
    )


@cache
def make_hello_layout(n_joints: int) -> np.dtype[np.void]:
    return np.dtype(
        [
            ("type", "u1"),
            ("protocol", "u1"),
            ("n_joints", "u1"),
            ("n_sensors", "u1"),
            ("rate_hz", "<u2"),
            ("boot_id", "<u4"),
            ("serial_number", f"S{SERIAL_NUMBER_BYTES}"),  # ASCII, zero padded
            ("bits", "u1", (n_joints,)),  # counts wrap at 2^bits
        ]
    )


PONG_LAYOUT = np.dtype([("type", "u1"), ("nonce", "<u4"), ("t_us", "<u8")])
PING_LAYOUT = np.dtype([("type", "u1"), ("nonce", "<u4")])

# Position of the number of values in each message, and its length without values.
_SAMPLE_N, _SAMPLE_HEAD = 3, make_sample_layout(0).itemsize
_TEMPERATURE_N, _TEMPERATURE_HEAD = 1, make_temperature_layout(0).itemsize
_HELLO_N, _HELLO_HEAD = 2, make_hello_layout(0).itemsize


@dataclass(frozen=True, slots=True)
class Hello:
    """The properties that an arm reports in HELLO."""

    protocol: int
    n_joints: int
    n_sensors: int
    rate_hz: int
    boot_id: int
    serial_number: str
    bits: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class TemperatureReading:
    celsius: F64  # (n,), NaN where the channel is invalid
    t_us: int


@dataclass(frozen=True, slots=True)
class Pong:
    nonce: int
    t_us: int


def pack(body: bytes) -> bytes:
    """Encode a body (type byte first) as a packet."""
    framed: bytes = cobs.encode(body + zlib.crc32(body).to_bytes(4, "little"))
    return framed + b"\0"


def unpack(packet: bytes) -> bytes | None:
    """Return body *and its four CRC bytes* of a packet without its 0x00; None if the CRC fails.

    Raises `cobs.DecodeError` where the packet is not COBS.
    """
    data: bytes = cobs.decode(packet)
    return data if len(data) > 4 and zlib.crc32(data) == CRC_RESIDUE else None


def encode_sample(
    seq: int, t_us: int, counts: npt.ArrayLike, joint_status: int = 0, buttons: int = 0
) -> bytes:
    """Encode one SAMPLE packet; *seq* and *counts* are taken modulo 2^32."""
    wrapped = np.asarray(counts, dtype=np.int64) & 0xFFFFFFFF
    row = np.zeros((), make_sample_layout(len(wrapped)))
    row["type"], row["n"] = Type.SAMPLE, len(wrapped)
    row["joint_status"], row["buttons"] = joint_status, buttons
    row["seq"], row["t_us"], row["count"] = seq & 0xFFFFFFFF, t_us, wrapped
    return pack(row.tobytes())


def encode_temperature(t_us: int, celsius: npt.ArrayLike) -> bytes:
    """Encode one TEMPERATURE packet; NaN and values too large for the field are sent as invalid."""
    values = np.asarray(celsius, dtype=np.float64)
    ticks = np.nan_to_num(np.round(values / TEMPERATURE_UNIT_C), nan=np.inf)
    fits = np.abs(ticks) <= np.iinfo(np.int16).max
    row = np.zeros((), make_temperature_layout(len(values)))
    row["type"], row["n"], row["t_us"] = Type.TEMPERATURE, len(values), t_us
    row["valid"] = sum(1 << i for i, ok in enumerate(fits) if ok)
    row["centi_celsius"] = np.where(fits, ticks, 0)
    return pack(row.tobytes())


def encode_hello(hello: Hello) -> bytes:
    row = np.zeros((), make_hello_layout(hello.n_joints))
    row["type"] = Type.HELLO
    for name in ("protocol", "n_joints", "n_sensors", "rate_hz", "boot_id", "bits"):
        row[name] = getattr(hello, name)
    row["serial_number"] = hello.serial_number.encode("ascii")
    return pack(row.tobytes())


def encode_pong(nonce: int, t_us: int) -> bytes:
    return pack(np.array((Type.PONG, nonce, t_us), PONG_LAYOUT).tobytes())


def encode_ping(nonce: int) -> bytes:
    return pack(np.array((Type.PING, nonce), PING_LAYOUT).tobytes())


def encode_identify() -> bytes:
    return pack(bytes([Type.IDENTIFY]))


def is_sample(data: bytes, n_joints: int) -> bool:
    """Return whether an unpacked SAMPLE (with CRC) is one of *n_joints* with a valid time."""
    return (
        len(data) == _SAMPLE_HEAD + 4 * n_joints + 4
        and data[_SAMPLE_N] == n_joints
        and data[15] == 0  # the two highest bytes of t_us: T_US_LIMIT
        and data[14] < 32
    )


def decode_samples(run: list[bytes], n_joints: int) -> npt.NDArray[np.void]:
    """Decode unpacked SAMPLEs of *n_joints* to an array (m,) of `make_row_layout(n_joints)`."""
    return np.frombuffer(bytearray().join(run), make_row_layout(n_joints))


def decode_temperature(data: bytes) -> TemperatureReading | None:
    """Decode an unpacked TEMPERATURE; None where its length is wrong or its time invalid."""
    n = data[_TEMPERATURE_N]
    if n > CHANNELS_MAX or len(data) != _TEMPERATURE_HEAD + 2 * n + 4:
        return None
    row = np.frombuffer(data[:-4], make_temperature_layout(n))[0]
    if row["t_us"] >= T_US_LIMIT:
        return None
    valid = (int(row["valid"]) >> np.arange(n)) & 1
    celsius = np.where(valid == 1, row["centi_celsius"] * TEMPERATURE_UNIT_C, np.nan)
    return TemperatureReading(celsius, int(row["t_us"]))


def decode_hello(data: bytes) -> Hello | None:
    """Decode an unpacked HELLO; None where its length is wrong.

    For another protocol version only the version is known; the rest is zero.
    """
    if len(data) < 2 + 4:
        return None
    if data[1] != PROTOCOL:
        return Hello(data[1], 0, 0, 0, 0, "", ())
    if len(data) < _HELLO_HEAD + 4 or len(data) != _HELLO_HEAD + data[_HELLO_N] + 4:
        return None
    row = np.frombuffer(data[:-4], make_hello_layout(data[_HELLO_N]))[0]
    return Hello(
        protocol=int(row["protocol"]),
        n_joints=int(row["n_joints"]),
        n_sensors=int(row["n_sensors"]),
        rate_hz=int(row["rate_hz"]),
        boot_id=int(row["boot_id"]),
        serial_number=bytes(row["serial_number"]).decode("ascii", "backslashreplace"),
        bits=tuple(int(b) for b in row["bits"]),
    )


def decode_pong(data: bytes) -> Pong | None:
    """Decode an unpacked PONG; None where its length is wrong or its time invalid."""
    if len(data) != PONG_LAYOUT.itemsize + 4:
        return None
    row = np.frombuffer(data[:-4], PONG_LAYOUT)[0]
    if row["t_us"] >= T_US_LIMIT:
        return None
    return Pong(int(row["nonce"]), int(row["t_us"]))


def decode_ping(data: bytes) -> int | None:
    """Return the nonce of an unpacked PING; None where its length is wrong."""
    if len(data) != PING_LAYOUT.itemsize + 4:
        return None
    return int(np.frombuffer(data[:-4], PING_LAYOUT)[0]["nonce"])


class CobsSplitter:
    """Cuts bytes, in pieces of any size, into packets at 0x00.

    `push` returns complete packets without their 0x00. A longer sequence than `PACKET_LIMIT` is
    junk: it is dropped up to the next 0x00 and counted in `junk`.
    """

    def __init__(self) -> None:
        self.junk = 0
        self.reset()

    def reset(self) -> None:
        """Forget an incomplete packet, as after a broken connection."""
        self._tail = b""
        self._skipping = False

    def cut(self, data: bytes) -> tuple[bytes, bytes]:
        """Return the packets that *data* completes, each with its 0x00, and the rest for `keep`.

        Both are empty if there is junk among them.
        """
        stream = self._tail + data
        end = stream.rfind(b"\0") + 1
        is_junk = self._skipping or len(stream) - end > PACKET_LIMIT
        return (b"", b"") if is_junk else (stream[:end], stream[end:])

    def keep(self, tail: bytes) -> None:
        """Keep the rest that `cut` returned."""
        self._tail = tail

    def push(self, data: bytes) -> list[bytes]:
        stream = self._tail + data
        packets = stream.split(b"\0")
        self._tail = packets.pop()
        if self._skipping or len(stream) > PACKET_LIMIT:
            packets = self._without_junk(packets)
        return [packet for packet in packets if packet]

    def _without_junk(self, packets: list[bytes]) -> list[bytes]:
        if self._skipping and packets:
            packets.pop(0)
            self._skipping = False
        if len(self._tail) > PACKET_LIMIT:
            self.junk += not self._skipping
            self._skipping = True
        if self._skipping:
            self._tail = b""
        self.junk += sum(len(packet) > PACKET_LIMIT for packet in packets)
        return [packet for packet in packets if len(packet) <= PACKET_LIMIT]

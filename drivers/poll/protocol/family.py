"""The properties of a servo, and the differences of servo families: registers and codec."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, asdict, dataclass
from typing import Any, Protocol

from armd.drivers.poll.protocol import dynamixel, feetech
from armd.drivers.poll.protocol.packet import Packet, ReadRequest, Splitter, Status

COUNTS_PER_TURN = 4096
SCS_SERIES = 5  # the first byte of its model numbers: an SCS0009 sends 5, 4
#: A Dynamixel in this mode ignores a homing offset beyond this many counts (e-Manual, register 20).
POSITION_MODE, OFFSET_IN_POSITION_MODE = 3, 1024


@dataclass(frozen=True, slots=True)
class Servo:
    """The properties of a servo, read from its registers at each connection."""

    model: int
    firmware: str
    homing_offset: int  # counts, as in the register
    reversed: bool  # it counts in the opposite direction
    mode: int  # operating mode, as in the register
    torque: bool  # on: it holds the joint
    return_delay_us: int  # its pause before an answer
    _: KW_ONLY
    offset_in_force: bool = True  # false where its mode ignores a homing offset of that size
    divider: int = 1  # divisor of its counts, where its mode divides them

    @property
    def geometry(self) -> dict[str, Any]:
        """The properties that shift or mirror the joint's angle; arm.toml is valid only for these
        values.
        """
        return {
            "model": self.model,
            "homing_offset": self.homing_offset,
            "reversed": self.reversed,
            "offset_in_force": self.offset_in_force,
        }

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def list_differences(servo: Servo, remembered: dict[str, Any], family: Family) -> list[str]:
    """List the differences, each as `homing offset (register 31): found 12, expected 0`.

    Empty if there are none.
    """
    phrases = []
    for name, actual in servo.geometry.items():
        expected = remembered.get(name, actual)
        if actual != expected:
            if name == "model":
                actual, expected = (find_model_name(n, family.models) for n in (actual, expected))
            phrases.append(f"{family.register(name)}: found {actual}, expected {expected}")
    return phrases


def find_model_name(model: int, models: dict[int, str]) -> str:
    return models.get(model, f"model {model}")


class Family(Protocol):
    """A family of servos. Registers are addresses; positions in an answer count from its first
    byte.
    """

    name: str
    models: dict[int, str]
    position: int  # the register at which a cycle's read begins
    position_bytes: int  # the least length with the position
    warm_bytes: int  # the least length with position and temperature
    identity_bytes: int  # from register 0 on, all that `identity` needs
    #: Addresses of a `Servo`'s fields and of its temperature; torque and return delay have 1 byte.
    registers: dict[str, int]
    id_register: int
    return_delay_least_us: int  # the least pause of a servo, whatever its register
    alarm: int | None  # register of the reason of `alerts`, 1 byte; None: the error byte has it
    has_fast: bool  # whether one packet may carry all answers
    has_sync: bool  # whether one request reads all servos; else each is read alone

    def register(self, name: str) -> str:
        """Return the name of a register in words, with its address."""
        return f"{name.removesuffix('_us').replace('_', ' ')} (register {self.registers[name]})"

    def refusal(self, servo: Servo) -> str:
        """Return why such a servo cannot be read, as found and expected; "" if it can."""
        ...

    def splitter(self) -> Splitter: ...

    def read(self, servo_id: int, address: int, length: int) -> bytes: ...

    def sync_read(
        self, ids: Sequence[int], address: int, length: int, fast: bool = False
    ) -> bytes: ...

    def write(self, servo_id: int, address: int, data: bytes) -> bytes: ...

    def request(self, packet: Packet) -> ReadRequest | None: ...

    def statuses(self, packet: Packet, length: int) -> list[Status]: ...

    def sizes(self, request: ReadRequest) -> range:
        """Return the permitted sizes of a packet of answers on the wire."""
        ...

    def answer_bytes(self, request: ReadRequest) -> int:
        """Return the number of bytes that one servo sends."""
        ...

    def completes(self, data: bytes, request: ReadRequest, missing: Sequence[int]) -> bool:
        """Return whether *data* alone are the *missing* answers, by a quick check."""
        ...

    def position_of(self, data: bytes, model: int | None) -> int:
        """Return counts of 4096 a turn; *model* of the servo, None before it is known."""
        ...

    def celsius_of(self, data: bytes) -> float:
        """Return the temperature in °C as the servo sends it, plausible or not.

        Both makers' libraries read a byte without sign.
        """
        ...

    def identity(self, data: bytes) -> Servo: ...

    def refuses(self, error: int) -> bool:
        """Return whether a status's error byte reports a refused request, without valid data."""
        ...

    def alerts(self, error: int) -> bool:
        """Return whether a status's error byte reports a fault; its data are valid."""
        ...

    def complaints(self, bits: int) -> str:
        """Return the faults in words, from the error byte or from register `alarm`."""
        ...


class ShortPackets(Family):
    """The packets of Feetech and of Dynamixel's protocol 1.0: addresses have one byte.

    The temperature is the eighth byte from the position on.
    """

    alarm: int | None = None
    has_fast = False

    def splitter(self) -> Splitter:
        return feetech.make_splitter()

    def read(self, servo_id: int, address: int, length: int) -> bytes:
        return feetech.make_read(servo_id, address, length)

    def write(self, servo_id: int, address: int, data: bytes) -> bytes:
        return feetech.make_write(servo_id, address, data)

    def statuses(self, packet: Packet, length: int) -> list[Status]:
        return feetech.decode_statuses(packet)

    def sizes(self, request: ReadRequest) -> range:
        size = feetech.compute_status_size(request.length)
        return range(size, size + 1)

    def answer_bytes(self, request: ReadRequest) -> int:
        return feetech.compute_status_size(request.length)

    def completes(self, data: bytes, request: ReadRequest, missing: Sequence[int]) -> bool:
        return feetech.are_statuses(data, missing, request.length)

    def celsius_of(self, data: bytes) -> float:
        return float(data[7])


class Feetech(ShortPackets):
    """STS and SMS servos; registers as in the STS3215's memory table."""

    name = "feetech"
    models = {777: "STS3215", 2825: "STS3250", 11272: "SM8512BL"}
    position, position_bytes, warm_bytes = 56, 2, 8
    identity_bytes = 41
    registers = {
        "model": 3, "firmware": 0, "homing_offset": 31, "reversed": 18, "mode": 33, "torque": 40,
        "return_delay_us": 7, "offset_in_force": 33, "temperature": 63,
    }  # fmt: skip
    id_register = 5
    return_delay_least_us = 50
    has_sync = True

    def refusal(self, servo: Servo) -> str:
        # That series is big-endian, so the byte may be the high one.
        if servo.model & 0xFF == SCS_SERIES or servo.model >> 8 == SCS_SERIES:
            actual = f"{servo.model}, a servo of the SCS series (big-endian, no sync read)"
            return (
                f"{self.register('model')}: found {actual}, expected one of the STS or SMS series"
            )
        return ""

    def sync_read(self, ids: Sequence[int], address: int, length: int, fast: bool = False) -> bytes:
        return feetech.make_sync_read(ids, address, length)

    def request(self, packet: Packet) -> ReadRequest | None:
        return feetech.decode_read_request(packet)

    def position_of(self, data: bytes, model: int | None) -> int:
        return feetech.decode_signed(data[0] | data[1] << 8, 15)

    def identity(self, data: bytes) -> Servo:
        return Servo(
            model=data[3] | data[4] << 8,
            firmware=f"{data[0]}.{data[1]}",
            homing_offset=feetech.decode_signed(data[31] | data[32] << 8, 11),
            reversed=bool(data[18] & 0x80),
            mode=data[33],
            torque=data[40] != 0,
            return_delay_us=2 * data[7],
        )

    def refuses(self, error: int) -> bool:
        return False

    def alerts(self, error: int) -> bool:
        return error != 0

    def complaints(self, bits: int) -> str:
        return name_bits(bits, feetech.ERRORS)


class Dynamixel(Family):
    """Servos of the X series; registers as in its control table, the same for all models."""

    name = "dynamixel"
    models = {
        1020: "XM430-W350", 1030: "XM430-W210", 1060: "XL430-W250", 1070: "XC430-W150",
        1080: "XC430-W240", 1100: "XH540-W270", 1110: "XH540-W150", 1120: "XM540-W270",
        1130: "XM540-W150", 1190: "XL330-M077", 1200: "XL330-M288", 1210: "XC330-T181",
        1220: "XC330-T288", 1230: "XC330-M181", 1240: "XC330-M288",
    }  # fmt: skip
    position, position_bytes, warm_bytes = 132, 4, 15
    identity_bytes = 71
    registers = {
        "model": 0, "firmware": 6, "homing_offset": 20, "reversed": 10, "mode": 11, "torque": 64,
        "return_delay_us": 9, "offset_in_force": 11, "temperature": 146,
    }  # fmt: skip
    id_register = 7
    return_delay_least_us = 40
    alarm: int | None = 70
    has_fast = True
    has_sync = True

    def refusal(self, servo: Servo) -> str:
        return ""

    def splitter(self) -> Splitter:
        return dynamixel.make_splitter()

    def read(self, servo_id: int, address: int, length: int) -> bytes:
        return dynamixel.make_read(servo_id, address, length)

    def sync_read(self, ids: Sequence[int], address: int, length: int, fast: bool = False) -> bytes:
        build = dynamixel.make_fast_sync_read if fast else dynamixel.make_sync_read
        return build(ids, address, length)

    def write(self, servo_id: int, address: int, data: bytes) -> bytes:
        return dynamixel.make_write(servo_id, address, data)

    def request(self, packet: Packet) -> ReadRequest | None:
        return dynamixel.decode_read_request(packet)

    def statuses(self, packet: Packet, length: int) -> list[Status]:
        return dynamixel.decode_statuses(packet, length)

    def sizes(self, request: ReadRequest) -> range:
        if request.fast:
            size = dynamixel.compute_fast_status_size(len(request.ids), request.length)
            return range(size, size + 1)
        size = dynamixel.compute_status_size(request.length)
        return range(
            dynamixel.compute_status_size(0), size + request.length // 3 + 1
        )  # refused … stuffed

    def answer_bytes(self, request: ReadRequest) -> int:
        return 4 + request.length if request.fast else dynamixel.compute_status_size(request.length)

    def completes(self, data: bytes, request: ReadRequest, missing: Sequence[int]) -> bool:
        return request.fast and dynamixel.is_fast_status(data, len(request.ids), request.length)

    def position_of(self, data: bytes, model: int | None) -> int:
        return int.from_bytes(data[:4], "little", signed=True)

    def celsius_of(self, data: bytes) -> float:
        return float(data[14])

    def identity(self, data: bytes) -> Servo:
        offset, mode = int.from_bytes(data[20:24], "little", signed=True), data[11]
        return Servo(
            model=data[0] | data[1] << 8,
            firmware=str(data[6]),
            homing_offset=offset,
            reversed=bool(data[10] & 1),
            mode=mode,
            torque=data[64] != 0,
            return_delay_us=2 * data[9],
            offset_in_force=mode != POSITION_MODE or abs(offset) <= OFFSET_IN_POSITION_MODE,
        )

    def refuses(self, error: int) -> bool:
        return bool(error & ~dynamixel.ALERT)

    def alerts(self, error: int) -> bool:
        return bool(error & dynamixel.ALERT)

    def complaints(self, bits: int) -> str:
        return name_bits(bits, dynamixel.HARDWARE_ERRORS)


def name_bits(bits: int, names: dict[int, str]) -> str:
    """Return the names of the set bits; an unnamed bit is called by its number."""
    standing = [bit for bit in range(8) if bits >> bit & 1]
    return ", ".join(names.get(bit, f"bit {bit}") for bit in standing)

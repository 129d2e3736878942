"""The families of servos, and one of them: AX, DX, RX and MX servos of Dynamixel's protocol 1.0.

Counts are 4096 a turn. Registers are those of the e-Manual's control tables of the AX-12A and the
MX-28 (protocol 1.0).
"""

from __future__ import annotations

from collections.abc import Sequence

from armd.drivers.poll.protocol import dynamixel1
from armd.drivers.poll.protocol.family import (
    COUNTS_PER_TURN,
    Dynamixel,
    Family,
    Feetech,
    Servo,
    ShortPackets,
    name_bits,
)
from armd.drivers.poll.protocol.packet import Packet, ReadRequest

#: 1024 counts over 300°, 512 in the middle
AX = {
    12: "AX-12", 18: "AX-18A", 300: "AX-12W", 24: "RX-24F", 28: "RX-28", 64: "RX-64",
    113: "DX-113", 116: "DX-116", 117: "DX-117",
}  # fmt: skip
#: 4096 counts a turn, 2048 in the middle
MX = {360: "MX-12W", 29: "MX-28", 310: "MX-64", 320: "MX-106"}
WHEEL_MODE, JOINT_MODE, MULTI_TURN_MODE = 1, 3, 4  # numbers of later series
#: counts of 4096 a turn in one count of an AX
NUMERATOR, DENOMINATOR = 10, 3
AX_MIDDLE, MIDDLE = 512, COUNTS_PER_TURN // 2


class Dynamixel1(ShortPackets):
    """Servos read one by one: only the MX series has a bulk read, and a missing servo ends it."""

    name = "dynamixel1"
    models = AX | MX
    position, position_bytes, warm_bytes = 36, 2, 8
    identity_bytes = 25
    registers = {
        "model": 0, "firmware": 2, "homing_offset": 20, "reversed": 10, "mode": 6, "torque": 24,
        "return_delay_us": 5, "offset_in_force": 6, "temperature": 43, "divider": 22,
    }  # fmt: skip
    id_register = 3
    return_delay_least_us = 40
    has_sync = False

    def refusal(self, servo: Servo) -> str:
        if servo.model not in self.models:
            expected = "a servo of the AX, DX, RX or MX series, whose counts a turn are known"
            return f"{self.register('model')}: found {servo.model}, expected {expected}"
        if servo.divider != 1:
            return f"{self.register('divider')}: found {servo.divider}, expected 1"
        return ""

    def sync_read(self, ids: Sequence[int], address: int, length: int, fast: bool = False) -> bytes:
        return dynamixel1.make_bulk_read([(servo, address, length) for servo in ids])

    def request(self, packet: Packet) -> ReadRequest | None:
        return dynamixel1.decode_read_request(packet)

    def position_of(self, data: bytes, model: int | None) -> int:
        position = int.from_bytes(data[:2], "little", signed=True)
        if model not in AX:
            return position
        return MIDDLE + round((position - AX_MIDDLE) * NUMERATOR / DENOMINATOR)

    def identity(self, data: bytes) -> Servo:
        model = data[0] | data[1] << 8
        is_mx = model in MX  # an AX uses registers 10 and 20 to 22 otherwise, or not at all
        low, high = (data[offset] | data[offset + 1] << 8 for offset in (6, 8))
        is_turning = is_mx and low == high == COUNTS_PER_TURN - 1
        mode = MULTI_TURN_MODE if is_turning else WHEEL_MODE if low == high == 0 else JOINT_MODE
        return Servo(
            model=model,
            firmware=str(data[2]),
            homing_offset=int.from_bytes(data[20:22], "little", signed=True) if is_mx else 0,
            reversed=MX.get(model) == "MX-106" and bool(data[10] & 1),
            mode=mode,
            torque=data[24] != 0,
            return_delay_us=2 * data[5],
            offset_in_force=is_turning,
            divider=max(data[22], 1) if is_turning else 1,
        )

    def refuses(self, error: int) -> bool:
        return bool(error & dynamixel1.REFUSALS)

    def alerts(self, error: int) -> bool:
        return bool(error & ~dynamixel1.REFUSALS)

    def complaints(self, bits: int) -> str:
        return name_bits(bits, dynamixel1.ERRORS)


#: by `kind` of `[driver]`
FAMILIES: dict[str, Family] = {
    "feetech": Feetech(),
    "dynamixel": Dynamixel(),
    "dynamixel1": Dynamixel1(),
}

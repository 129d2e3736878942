"""One servo: a table of registers, filled when it is read."""

from __future__ import annotations

from dataclasses import dataclass, field

from armd.drivers.poll.protocol.feetech import ERRORS as FEETECH_ERRORS

SIGN = 0x8000


@dataclass(kw_only=True)
class Registers:
    """The addresses of a family's registers."""

    size: int
    position: int
    temperature: int
    torque: int
    return_delay: int
    homing: int
    firmware: int  # its last byte
    eeprom_end: int  # registers below this survive a power loss
    lock: int | None  # value 1: written EEPROM registers are not kept (Feetech)


FEETECH = Registers(
    size=128, position=56, temperature=63, torque=40, return_delay=7, homing=31, firmware=1,
    eeprom_end=40, lock=55,
)  # fmt: skip
DYNAMIXEL = Registers(
    size=1024, position=132, temperature=146, torque=64, return_delay=9, homing=20, firmware=6,
    eeprom_end=64, lock=None,
)  # fmt: skip
DYNAMIXEL1 = Registers(
    size=128, position=36, temperature=43, torque=24, return_delay=5, homing=20, firmware=2,
    eeprom_end=24, lock=None,
)  # fmt: skip
REGISTERS = {"feetech": FEETECH, "dynamixel": DYNAMIXEL, "dynamixel1": DYNAMIXEL1}
AX_12, MX_28 = 12, 29  # models of protocol 1.0
ONE_TURN, MANY_TURNS = (0, 4095), (4095, 4095)  # limits of an MX-28


@dataclass
class SimulatedServo:
    """A servo with its registers; the bus decides when it samples."""

    id: int
    kind: str
    firmware: int = 10
    table: bytearray = field(init=False)
    error: int = 0  # the error byte of its statuses
    offset: int = 0  # counts, a change of its homing offset by another tool
    model: int = MX_28  # of protocol 1.0

    def __post_init__(self) -> None:
        self.feetech = self.kind == "feetech"
        self.registers = REGISTERS[self.kind]
        self.table = table = bytearray(self.registers.size)
        if self.feetech:
            table[0:2] = bytes([3, self.firmware])
            table[3:9] = bytes([0x09, 0x03, self.id, 0, 0, 1])
            table[9:14] = bytes([0, 0, 0xFF, 0x0F, 70])
            table[18], table[55], table[62] = 12, 1, 121
        elif self.kind == "dynamixel1":
            table[0:6] = bytes([self.model, 0, self.firmware + 25, self.id, 1, 0])
            table[11:17] = bytes([80, 60, 160, 255, 3, 2])
            self._set_limits((0, 1023) if self.model == AX_12 else ONE_TURN)
            table[22], table[42] = int(self.model == MX_28), 121
        else:
            table[0:2] = (1060).to_bytes(2, "little")
            table[6:10] = bytes([self.firmware + 35, self.id, 3, 0])
            table[11], table[12], table[13], table[31] = 3, 255, 2, 72
            table[48:52] = (4095).to_bytes(4, "little")
            table[68], table[144] = 2, 121
        self._eeprom = bytes(table[: self.registers.eeprom_end])

    def feel(self, raw: int, celsius: float, time_s: float, runs_on: bool) -> None:
        """Sample position and temperature. *runs_on*: over the turns, unfolded."""
        table, registers = self.table, self.registers
        homed_counts = raw - self.offset if self.feetech else raw + self.offset
        position = homed_counts if runs_on else homed_counts % 4096
        if self.feetech:
            word = (SIGN | -position) if position < 0 else position
            table[56:58] = word.to_bytes(2, "little")
        elif self.kind == "dynamixel1":
            if self.model == AX_12:  # 300° of a turn; its end values beyond
                position = min(max((homed_counts - 2048) * 3 // 10 + 512, 0), 1023)
            table[36:38] = position.to_bytes(2, "little", signed=True)
        else:
            table[132:136] = position.to_bytes(4, "little", signed=True)
            table[120:122] = (int(time_s * 1000) & 0x7FFF).to_bytes(2, "little")
        table[registers.temperature] = max(0, min(255, round(celsius)))

    def set_homing(self, counts: int) -> None:
        """Change the homing register, as another tool would, and all later positions."""
        address = self.registers.homing
        if self.feetech:
            word = abs(counts) | (0x800 if counts < 0 else 0)
            self.table[address : address + 2] = word.to_bytes(2, "little")
        elif self.kind == "dynamixel1":
            if self.model == AX_12:
                return  # it has no homing offset
            self._set_limits(MANY_TURNS if counts else ONE_TURN)
            self.table[address : address + 2] = counts.to_bytes(2, "little", signed=True)
        else:
            self.table[address : address + 4] = counts.to_bytes(4, "little", signed=True)
        self.offset = counts
        self._eeprom = bytes(self.table[: self.registers.eeprom_end])

    def _set_limits(self, limits: tuple[int, int]) -> None:
        self.table[6:10] = b"".join(limit.to_bytes(2, "little") for limit in limits)

    def alert(self, on: bool) -> None:
        """Set or reset an overload, as the family reports it."""
        bit = next(bit for bit, name in FEETECH_ERRORS.items() if name == "overload")
        if self.kind != "dynamixel":  # both older protocols have this bit
            self.error = 1 << bit if on else 0
        else:
            self.error, self.table[70] = (0x80, 1 << bit) if on else (0, 0)

    def read(self, address: int, length: int) -> bytes:
        return bytes(self.table[address : address + length])

    def write(self, address: int, data: bytes) -> int:
        """Write registers; return the status's error, 0 for success.

        A Dynamixel refuses writes to its EEPROM while the torque is on. A locked Feetech accepts
        them, and loses them at a restart.
        """
        registers, lasting = self.registers, address < self.registers.eeprom_end
        if lasting and self.kind == "dynamixel" and self.table[registers.torque]:
            return 7  # access error
        self.table[address : address + len(data)] = data
        if lasting and not (registers.lock is not None and self.table[registers.lock]):
            self._eeprom = bytes(self.table[: registers.eeprom_end])
        return 0

    def start_anew(self) -> None:
        """Restart, as after a power loss."""
        self.table[: self.registers.eeprom_end] = self._eeprom
        self.table[self.registers.torque] = 0

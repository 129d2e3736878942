"""All objects, identifiers and PDO layouts that armd uses of an arm on CANopen.

CiA 301 (communication), CiA 406 (encoders), CiA 404 (measuring devices). Nothing here accesses a
bus. Object 6003 (preset) is not in the list: armd never writes it.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import NamedTuple

# --- nodes ---------------------------------------------------------------------------------

TEMPERATURE_NODES = (0x20, 0x21)  # joints 1…N are nodes 1…N
CHANNELS_PER_MODULE = 6
CHANNELS_PER_PDO = 2

# --- identifiers (predefined connection set) -------------------------------------------------

NMT_ID = 0x000
SYNC_ID = 0x080
EMCY_BASE = 0x080
TPDO_BASE = (0x180, 0x280, 0x380, 0x480)
SDO_REPLY_BASE = 0x580
SDO_REQUEST_BASE = 0x600
HEARTBEAT_BASE = 0x700

# NMT states in a heartbeat
BOOT_UP = 0x00
STOPPED = 0x04
OPERATIONAL = 0x05
PRE_OPERATIONAL = 0x7F

# --- objects: index, or (index, subindex) ----------------------------------------------------

DEVICE_TYPE = 0x1000  # low half: profile
ERROR_REGISTER = 0x1001
HEARTBEAT_TIME_MS = 0x1017
SERIAL_NUMBER = (0x1018, 4)
TPDO_COMMUNICATION = 0x1800  # + PDO - 1; sub 1 COB-ID, sub 2 transmission type
PDO_OFF = 1 << 31  # in a COB-ID: the PDO does not exist
NO_REMOTE_FRAMES = 1 << 30  # in a COB-ID: remote frames do not request it
TPDO_MAPPING = 0x1A00  # + PDO - 1

ENCODER_PROFILE = 0x196  # CiA 406
OPERATING_PARAMETERS = 0x6000  # bit 2: scaling by 6001 and 6002 is on
UNITS_PER_TURN = 0x6001
TOTAL_RANGE = 0x6002
POSITION = 0x6004  # u32
PHYSICAL_RESOLUTION = 0x6501  # steps per turn
TURNS = 0x6502  # number of turns that the encoder distinguishes
ALARMS = 0x6503  # u16: the position may be wrong
WARNINGS = 0x6505  # u16: the position is valid
SCALING = 1 << 2  # in OPERATING_PARAMETERS

MEASURING_PROFILE = 0x194  # CiA 404
CHANNEL_STATUS = 0x6150  # sub n: channel n, u8; bit 0: its value is invalid
PROCESS_VALUE = 0x9130  # sub n: channel n, i32 in 0.001 °C
PROCESS_VALUE_UNIT_C = 0.001

# --- PDO layouts -----------------------------------------------------------------------------

#: TPDO1 of an encoder: position and alarms, or only the position if it cannot map its alarms.
ENCODER_PDO = struct.Struct("<IH")
ENCODER_MAPPING = ((POSITION, 0, 32), (ALARMS, 0, 16))
POSITION_MAPPING = ((POSITION, 0, 32),)
#: TPDO1–3 of a temperature module: two process values; TPDO4: six status bytes.
VALUES_PDO = struct.Struct("<ii")
STATUS_PDO = struct.Struct("<6B")
STATUS_PDO_NUMBER = 4
EMCY = struct.Struct("<HB5x")  # error code, error register, manufacturer's own bytes


class EncoderLayout(NamedTuple):
    """The layout of an encoder's TPDO1, in bytes from its beginning."""

    size: int
    position_at: int
    alarms_at: int | None  # None: its alarms are read by SDO


ENCODER_LAYOUT = EncoderLayout(ENCODER_PDO.size, 0, 4)


def list_mapped_values(pdo: int) -> tuple[tuple[int, int, int], ...]:
    """List (index, subindex, bits) of the values in TPDO *pdo* = 1…4 of a temperature module."""
    if pdo == STATUS_PDO_NUMBER:
        return tuple((CHANNEL_STATUS, n, 8) for n in range(1, CHANNELS_PER_MODULE + 1))
    first = CHANNELS_PER_PDO * (pdo - 1) + 1
    return tuple((PROCESS_VALUE, n, 32) for n in range(first, first + CHANNELS_PER_PDO))


# --- a frame as it is recorded -----------------------------------------------------------------

_FRAME_ID = struct.Struct("<I")
EXTENDED = 1 << 31  # flags above the identifier, as in Linux's struct can_frame
REMOTE = 1 << 30
ERROR = 1 << 29


@dataclass(frozen=True, slots=True)
class CanFrame:
    """One CAN frame; `identifier` carries the flags above in its high bits."""

    identifier: int
    data: bytes

    def to_bytes(self) -> bytes:
        """Return `RawFrame.data`: the u32 identifier with flags, little-endian, then the data."""
        return _FRAME_ID.pack(self.identifier) + self.data

    @staticmethod
    def from_bytes(raw: bytes) -> CanFrame:
        return CanFrame(_FRAME_ID.unpack_from(raw)[0], raw[_FRAME_ID.size :])

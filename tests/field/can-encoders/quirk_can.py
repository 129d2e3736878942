"""armd's own simulated CAN arm, its encoders changed as CiA 301 and 406 allow.

QUIRK=no_rtr|no_serial|no_alarm_map|fixed_map|class_c1|bare_c1
python quirk_can.py --can socketcand --arm-out arm.toml --seconds 30
"""

import os
import sys

from canopen.sdo import SdoAbortedError

import armd.simulator.canbus.objects as objects

QUIRK = os.environ["QUIRK"]
Objects = objects.Objects
begin, put, get, find = Objects.__init__, Objects.set_data, Objects.get_data, Objects._find
#: Scaling, preset and diagnosis: what CiA 406 demands of class C2 alone.
OF_C2 = {0x6001, 0x6002, 0x6003, *range(0x6503, 0x650C)}
#: Of class C1 with nothing beyond what CiA 406 demands of it.
OF_C1_OPTIONAL = {0x6501, 0x6502}
FIXED = {0: b"\x01", 1: (0x60040020).to_bytes(4, "little")}


def __init__(self, eds, node_id, *rest):
    self.node = node_id
    begin(self, eds, node_id, *rest)


def set_data(self, index, sub, data, check_writable=False):
    value = int.from_bytes(data, "little")
    if self.node < 0x20:
        if QUIRK == "no_rtr" and (index, sub) == (0x1800, 1) and not value & 1 << 30:
            raise SdoAbortedError(0x06090030)
        if QUIRK == "fixed_map" and index == 0x1A00:
            raise SdoAbortedError(0x06010002)
        if QUIRK.endswith("_c1") and index == 0x1A00 and sub and value >> 16 in OF_C2:
            raise SdoAbortedError(0x06020000)
        if QUIRK == "no_alarm_map" and index == 0x1A00 and sub and value >> 16 == 0x6503:
            raise SdoAbortedError(0x06040041)
    put(self, index, sub, data, check_writable)


def get_data(self, index, sub, check_readable=False):
    if self.node < 0x20:
        if QUIRK == "no_rtr" and (index, sub) == (0x1800, 1) and (index, sub) not in self._written:
            return (0x40000180 + self.node).to_bytes(4, "little")
        if QUIRK == "fixed_map" and index == 0x1A00:
            return FIXED[sub]
    return get(self, index, sub, check_readable)


def _find(self, index, sub):
    if self.node < 0x20 and QUIRK == "no_serial" and (index, sub) == (0x1018, 4):
        raise SdoAbortedError(0x06090011)
    if self.node < 0x20 and QUIRK.endswith("_c1") and index in OF_C2:
        raise SdoAbortedError(0x06020000)
    if self.node < 0x20 and QUIRK == "bare_c1" and index in OF_C1_OPTIONAL:
        raise SdoAbortedError(0x06020000)
    return find(self, index, sub)


Objects.__init__, Objects.set_data, Objects.get_data, Objects._find = (
    __init__,
    set_data,
    get_data,
    _find,
)

from armd.simulator.__main__ import main  # noqa: E402

sys.exit(main(sys.argv[1:]))

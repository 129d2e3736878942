"""One CANopen node: NMT, heartbeat, SDO server, synchronous TPDOs, emergencies.

The object dictionary and the SDO protocol are the `canopen` library's. Its NMT and heartbeat run in
threads, so these few rules are our own and run in the device's only loop.
"""

from __future__ import annotations

from importlib.resources.abc import Traversable
from typing import Any, NamedTuple

from canopen.sdo import SdoAbortedError, SdoServer

from armd.drivers.can import objects as can
from armd.simulator.canbus.objects import WRONG_STATE, Objects
from armd.simulator.canbus.wires import Frame

SYNCHRONOUS = range(1, 241)  # transmission types: every n-th SYNC
PDO_OFF = 1 << 31
PRESET = 0x6003
SERIAL_NUMBERS = 406000  # serial number of a simulated node: this plus its number


class Tpdo(NamedTuple):
    """A TPDO as the host has configured it."""

    cob_id: int
    kind: int  # transmission type
    objects: list[tuple[int, int]]  # index and sub-index of the mapped objects


class SimulatedNode:
    """A node just after power-up; subclasses define its measured values."""

    def __init__(self, node_id: int, eds: Traversable, tpdos: int) -> None:
        self.node_id = node_id
        self._tpdos = tpdos
        self._objects = Objects(eds, node_id, self.read_measured, self._before_write)
        self._sdo: Any = SdoServer(
            can.SDO_REQUEST_BASE + node_id, can.SDO_REPLY_BASE + node_id, self._objects
        )
        self._sdo.network = self  # for its `send_message`
        self.outbox: list[Frame] = []
        self.preset_written = False
        self.mute = False  # neither receives nor sends
        self.no_heartbeat = False
        self.no_pdo = False
        self.boot()

    def read_measured(self, index: int, sub_index: int) -> int | None:
        """Return the present value of an object; None for one that only stores written values."""
        if index == can.ERROR_REGISTER:
            return self.error_register
        return SERIAL_NUMBERS + self.node_id if (index, sub_index) == can.SERIAL_NUMBER else None

    def boot(self) -> None:
        """Restore the factory settings, then send the boot-up message."""
        self._objects.factory_settings()
        self.error_register = 0
        self._state = can.PRE_OPERATIONAL
        self._configuration: list[Tpdo] | None = None  # parsed again after each write
        self._syncs = 0
        self._next_heartbeat_ns = 0
        self._send(can.HEARTBEAT_BASE + self.node_id, bytes([can.BOOT_UP]))

    def hear(self, frame: Frame) -> None:
        """Receive a frame of the host other than SYNC."""
        if self.mute:
            return
        if (
            frame.can_id == can.NMT_ID
            and len(frame.data) == 2
            and frame.data[1] in (0, self.node_id)
        ):
            self._command(frame.data[0])
        asks = frame.can_id == can.SDO_REQUEST_BASE + self.node_id and len(frame.data) == 8
        if asks and self._state != can.STOPPED:
            self._sdo.on_request(frame.can_id, bytearray(frame.data), 0.0)

    def on_sync(self) -> None:
        """Queue the TPDOs due at this SYNC; their values are latched by now."""
        self._syncs += 1
        for tpdo in self._configured():
            if tpdo.kind in SYNCHRONOUS and self._syncs % tpdo.kind == 0:
                self._transmit(tpdo)

    def tick(self, now_ns: int) -> None:
        """Queue the heartbeat when it is due."""
        period_ms = self._objects.number(can.HEARTBEAT_TIME_MS, 0)
        if period_ms and not self.no_heartbeat and now_ns >= self._next_heartbeat_ns:
            self._next_heartbeat_ns = now_ns + period_ms * 1_000_000
            self._send(can.HEARTBEAT_BASE + self.node_id, bytes([self._state]))

    def emergency(self, code: int, register: int) -> None:
        """Send EMCY; code 0 resets the last one."""
        self.error_register = register
        self._send(can.EMCY_BASE + self.node_id, can.EMCY.pack(code, register))

    def send_message(self, can_id: int, data: bytes) -> None:
        """Send a frame of the SDO server."""
        self._send(can_id, bytes(data))

    def _send(self, can_id: int, data: bytes) -> None:
        if not self.mute:
            self.outbox.append(Frame(can_id, data))

    def _command(self, command: int) -> None:
        match command:
            case 1:
                self._state = can.OPERATIONAL
            case 2:
                self._state = can.STOPPED
            case 128:
                self._state = can.PRE_OPERATIONAL
            case 129 | 130:
                self.boot()

    def _transmit(self, tpdo: Tpdo) -> None:
        on = self._state == can.OPERATIONAL and not tpdo.cob_id & PDO_OFF and not self.no_pdo
        if on and tpdo.objects:
            data = b"".join(self._objects.get_data(*place) for place in tpdo.objects)
            self._send(tpdo.cob_id & 0x7FF, data)

    def _configured(self) -> list[Tpdo]:
        if self._configuration is None:
            self._configuration = [
                Tpdo(
                    self._objects.number(can.TPDO_COMMUNICATION + number, 1),
                    self._objects.number(can.TPDO_COMMUNICATION + number, 2),
                    self._mapped(can.TPDO_MAPPING + number),
                )
                for number in range(self._tpdos)
            ]
        return self._configuration

    def _mapped(self, index: int) -> list[tuple[int, int]]:
        entries = (
            self._objects.number(index, k + 1) for k in range(self._objects.number(index, 0))
        )
        return [(entry >> 16, entry >> 8 & 0xFF) for entry in entries]

    def _before_write(self, index: int, sub_index: int) -> None:
        """Refuse writes that CiA 301 forbids: a PDO is remapped only while it is off and empty."""
        self.preset_written |= index == PRESET
        self._configuration = None
        number = index - can.TPDO_MAPPING
        if 0 <= number < self._tpdos:
            on = not self._objects.number(can.TPDO_COMMUNICATION + number, 1) & PDO_OFF
            if on or (sub_index != 0 and self._objects.number(index, 0) != 0):
                raise SdoAbortedError(WRONG_STATE)

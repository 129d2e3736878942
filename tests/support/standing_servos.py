"""Servos on a pty, as plain as the makers' manuals have them: a table of bytes for each id.

They answer pings, reads and sync reads, keep what was asked, and never forget to object: a write
of any kind is noted in `writes`.
"""

from __future__ import annotations

import os
import select
import termios
import threading
import tty
from types import TracebackType

from armd.drivers.poll.protocol import dynamixel


class FakeServos:
    """`with FakeServos("feetech", {1: table, …}) as bus: … bus.port`."""

    def __init__(
        self,
        kind: str,
        tables: dict[int, bytearray],
        weak: int = 0,
        odd: int = 0,
        baud: int | None = None,
    ) -> None:
        """*weak*: this id answers every second sync read only; *odd*: this one hears *baud* alone,
        the others all rates."""
        self.kind = kind
        self._weak, self._tired = weak, False
        self._odd, self._baud = odd, baud
        self.tables = tables
        self.writes: list[bytes] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> FakeServos:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)

    def _serve(self) -> None:
        heard = b""
        while not self._stop.is_set():
            if select.select([self._master], [], [], 0.02)[0]:
                heard += os.read(self._master, 4096)
                heard = self._feetech(heard) if self.kind == "feetech" else self._dynamixel(heard)

    def _feetech(self, heard: bytes) -> bytes:
        while (at := heard.find(b"\xff\xff")) >= 0:
            heard = heard[at:]
            if len(heard) < 6 or len(heard) < heard[3] + 4:
                return heard
            servo, length, code = heard[2:5]
            params, body = heard[5 : length + 3], heard[2 : length + 4]
            if length < 2 or length > 60 or sum(body) & 0xFF != 0xFF:
                heard = heard[1:]
                continue
            heard = heard[length + 4 :]
            if code == 0x01:
                self._answer_feetech(servo, b"")
            elif code == 0x02:
                self._answer_feetech(servo, params)
            elif code == 0x82:
                self._tired = not self._tired
                for each in params[2:]:
                    if each != self._weak or not self._tired:
                        self._answer_feetech(each, params[:2])
            else:
                self.writes.append(body)
        return heard[-1:]

    def _answer_feetech(self, servo: int, span: bytes) -> None:
        if servo in self.tables and self._hears(servo):
            data = self.tables[servo][span[0] : span[0] + span[1]] if span else b""
            body = bytes([servo, len(data) + 2, 0]) + bytes(data)
            os.write(self._master, b"\xff\xff" + body + bytes([~sum(body) & 0xFF]))

    def _hears(self, servo: int) -> bool:
        if servo != self._odd:
            return True
        speed = termios.tcgetattr(self._slave)[5]
        return bool(speed == getattr(termios, f"B{self._baud}"))

    def _dynamixel(self, heard: bytes) -> bytes:
        splitter = dynamixel.make_splitter()
        for packet in splitter.push(heard):
            request = dynamixel.decode_read_request(packet)
            if packet.code == 0x01 and packet.id in self.tables:
                model = bytes(self.tables[packet.id][:2] + self.tables[packet.id][6:7])
                os.write(self._master, dynamixel.make_status(packet.id, 0, model))
            elif request is not None and not request.fast:
                for servo in request.ids:
                    if servo in self.tables:
                        end = request.address + request.length
                        data = bytes(self.tables[servo][request.address : end])
                        os.write(self._master, dynamixel.make_status(servo, 0, data))
            elif packet.code not in (0x01, 0x8A):
                self.writes.append(packet.raw)
        return b""


def sts3215(firmware: tuple[int, int] = (3, 10), torque: int = 0, delay: int = 0) -> bytearray:
    """A memory table as after LeRobot's set-up."""
    table = bytearray(128)
    table[0:2] = bytes(firmware)
    table[3:5] = (777).to_bytes(2, "little")
    table[7], table[18], table[40] = delay, 12, torque
    table[31:33] = (0x0800 | 85).to_bytes(2, "little")  # −85
    table[56:58], table[62], table[63] = (2048).to_bytes(2, "little"), 121, 30
    return table


def xl330(torque: int = 0, delay: int = 250) -> bytearray:
    """A control table as from the factory, but for the torque."""
    table = bytearray(256)
    table[0:2] = (1200).to_bytes(2, "little")
    table[6], table[9], table[11], table[64] = 52, delay, 3, torque
    table[132:136], table[146] = (2048).to_bytes(4, "little"), 31
    return table

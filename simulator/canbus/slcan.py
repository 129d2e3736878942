"""A serial-line CAN adapter (slcan) on a pty, like a CANable: ASCII commands, no acknowledges."""

from __future__ import annotations

import time
from pathlib import Path

from armd.simulator.canbus.wires import Frame
from armd.simulator.live.pty_port import PtyPort


class SlcanWire:
    """The adapter between a pty and the bus; it forwards frames while its channel is open (`O`)."""

    def __init__(self, link: Path | None = None) -> None:
        self._port = PtyPort(link)
        self.address = self._port.path if link is None else str(link)
        self._received = b""
        self._open = False

    def receive(self, timeout_s: float) -> list[Frame]:
        if not self._port.plugged:
            time.sleep(timeout_s)
            return []
        *commands, self._received = (self._received + self._port.read(timeout_s)).split(b"\r")
        return [frame for command in commands if (frame := self._obey(command)) is not None]

    def send(self, frames: list[Frame]) -> None:
        if self._open and self._port.plugged:
            text = b"".join(
                b"t%03X%X%s\r" % (can_id, len(data), data.hex().upper().encode())
                for can_id, data, _ in frames
            )
            self._port.write(text)

    def down(self) -> None:
        self._port.unplug()
        self._open = False
        self._received = b""

    def up(self) -> None:
        if not self._port.plugged:
            self._port.plug()

    close = down

    def _obey(self, command: bytes) -> Frame | None:
        match command[:1]:
            case b"O":
                self._open = True
            case b"C":
                self._open = False
            case b"V":
                self._port.write(b"V0101\r")
            case b"N":
                self._port.write(b"NA000\r")
            case b"t" if self._open:
                try:
                    can_id, data = int(command[1:4], 16), bytes.fromhex(command[5:].decode())
                except ValueError:
                    return None
                if len(data) == int(command[4:5], 16):
                    return Frame(can_id, data, time.monotonic_ns())
        return None

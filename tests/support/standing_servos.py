"""Servos that stand still, each a table of bytes as a maker or LeRobot left it: for who only looks.

A write of any kind is noted in `writes`.
"""

from __future__ import annotations

import os
import tempfile
import termios
from pathlib import Path

from support import fake_servos


class FakeServos(fake_servos.FakeServos):
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
        self._weak, self._odd, self._baud = weak, odd, baud
        families = {"feetech": fake_servos.Feetech, "dynamixel": fake_servos.Dynamixel}
        self._folder = tempfile.TemporaryDirectory()
        super().__init__(families[kind], Path(self._folder.name), ids=())
        self.registers, self.errors = tables, dict.fromkeys(tables, 0)
        self.port = os.ttyname(self._slave)

    def __exit__(self, *raised: object) -> None:
        super().__exit__(*raised)
        self._folder.cleanup()

    def _answer(self, instruction: int, servo: int, params: bytes) -> None:
        if instruction == 0x82:
            self.no_sync ^= {self._weak}
        if self._odd:
            speed = termios.tcgetattr(self._slave)[5]
            self.silent = set() if speed == getattr(termios, f"B{self._baud}") else {self._odd}
        super()._answer(instruction, servo, params)


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

"""Reads the factory data of a MicroScribe once: its identity and its geometry."""

from __future__ import annotations

import termios
import time
from collections.abc import Sequence
from dataclasses import dataclass

import serial

from armd.drivers.microscribe import wire
from armd.drivers.waiting import has_bytes
from armd.errors import BadInput

SYNC_S, REPLY_S, TRIES = 0.03, 0.3, 3
PER_BAUD_S = 0.9


@dataclass(frozen=True)
class Factory:
    serial_number: str
    model: str  # "DX", …
    format: str  # format of the parameters: "Format DH0.5"
    firmware: str
    counts_per_turn: tuple[int, ...]
    parameters: tuple[int, ...]  # α, A, D of six frames, in the units of the wire
    beta: int  # 0 for arms without one
    baud: int


def read_factory(port: str, baud: int | None = None) -> Factory:
    """Read the data in a session on *port*; raises `BadInput` if no MicroScribe answers."""
    bauds = wire.BAUDS if baud is None else (baud,)
    for rate in bauds:
        try:
            with serial.Serial(port, rate, timeout=0, exclusive=True) as line:
                talk = _Talk(line)
                if talk.begin():
                    try:
                        return _ask(talk, port, rate)
                    finally:
                        line.write(bytes([wire.END]))
        except (OSError, ValueError, termios.error) as error:
            raise BadInput(port, "the port", str(error), "a serial port to open") from error
    tried = ", ".join(map(str, bauds))
    expected = f'a MicroScribe that echoes "IMMC" (tried {tried} baud)'
    raise BadInput(port, "the port", "no answer", expected)


def _ask(talk: _Talk, port: str, baud: int) -> Factory:
    def answer(command: int, name: str) -> bytes:
        packet = talk.ask(command)
        if packet is None:
            raise BadInput(port, name, f"no answer to {command:02X}", "the arm's own answer")
        return packet

    texts = {
        name: wire.decode_text(answer(command, name))
        for command, name in (
            (wire.SERIAL_NUMBER, "serial number"),
            (wire.MODEL, "model"),
            (wire.COMMENT, "comment"),
            (wire.FORMAT, "format"),
            (wire.FIRMWARE, "firmware"),
        )
    }
    # An arm without extended parameters does not answer that question at all.
    extended = "beta" in texts["comment"].lower()
    beta = wire.decode_words(answer(wire.EXTENDED, "extended parameters"))[0] if extended else 0
    return Factory(
        texts["serial number"],
        texts["model"],
        texts["format"],
        texts["firmware"],
        wire.decode_counts_per_turn(answer(wire.MAXIMA, "maxima")),
        wire.decode_words(answer(wire.PARAMETERS, "parameters")),
        beta,
        baud,
    )


class _Talk:
    """Sends questions and receives answers, one at a time."""

    def __init__(self, line: serial.Serial) -> None:
        self._line = line

    def begin(self) -> bool:
        """Begin a session; return whether a MicroScribe answers at this rate."""
        self._line.write(bytes([wire.END]))
        time.sleep(0.015)
        self._line.reset_input_buffer()
        deadline = time.monotonic() + PER_BAUD_S
        while time.monotonic() < deadline:
            self._line.write(wire.SYNC)
            if wire.SYNC in self._hear(SYNC_S, [wire.SYNC]):
                self._line.reset_input_buffer()
                self._line.write(wire.BEGIN)
                if wire.GREETING in self._hear(REPLY_S, [wire.GREETING]):
                    self._hear(0.02, [b"\0"])
                    return True
        return False

    def ask(self, command: int) -> bytes | None:
        """Return the reply to *command*; None if none comes after `TRIES` attempts."""
        for _ in range(TRIES):
            self._line.reset_input_buffer()
            self._line.write(bytes([command]))
            heard, deadline = b"", time.monotonic() + REPLY_S
            while time.monotonic() < deadline:
                heard += self._hear(0.05, [])
                packet, _ = wire.take(command, heard)
                if packet is not None:
                    return packet
            packet, _ = wire.take(command, heard, complete=True)
            if packet is not None:
                return packet
        return None

    def _hear(self, seconds: float, until: Sequence[bytes]) -> bytes:
        """Return the bytes of *seconds*, or those up to one of *until*.

        If *until* is empty, return after the first bytes.
        """
        heard, deadline = b"", time.monotonic() + seconds
        while (remaining_s := deadline - time.monotonic()) > 0:
            if not has_bytes(self._line.fileno(), remaining_s):
                break
            heard += self._line.read(4096)
            if not until or any(word in heard for word in until):
                break
        return heard

"""Identifies the servos of a connection, and writes their configured registers.

It checks whether they are those of the arm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from serial.tools import list_ports

from armd.drivers.config import ServoConfig
from armd.drivers.poll.decoder import ServoDecoder, encode_note
from armd.drivers.poll.plan import RequestPlan
from armd.drivers.poll.protocol.packet import ReadRequest
from armd.drivers.poll.servos.memory import Memory
from armd.errors import BadInput

TRIES = 3  # identity requests before a servo counts as missing
LOOK_EVERY_NS = 250_000_000  # how often to check for `armd accept`


class Acquaintance:
    """The identification of servos on one line; call `restart` with each connection."""

    def __init__(
        self, config: ServoConfig, decoder: ServoDecoder, plan: RequestPlan, serial_number: str
    ) -> None:
        self._config = config
        self._decoder = decoder
        self._plan = plan
        self._memory = Memory(serial_number, decoder.family)
        self.restart()

    def restart(self) -> None:
        self._tries = 0
        self._unanswered = 0  # sync reads since a servo answered a single read
        #: the geometries of the last verdict, by servo id
        self._judged: dict[int, dict[str, Any]] | None = None
        self._version = -1  # version of the roster at the last verdict
        self._idle_version = -1  # version of the roster when there was nothing to write
        self._remembered_ns = 0
        self._look_due_ns = 0
        self._adapter_asked = False
        self._written: set[tuple[int, int]] = set()  # servo and register
        self._refused_writes: set[tuple[int, int]] = set()  # those of them that were not stored
        self._check: list[int] = []  # servos to read after a write
        self._checked: set[int] = set()  # servos asked since
        self._refusals: list[bytes] = []  # notes on writes that were not stored

    def question(self, now_ns: int) -> ReadRequest | None:
        """Return the next request of identification, if there is one.

        Before the first cycle it asks all servos not yet identified; later those that were written.
        """
        roster = self._decoder.roster
        if self._check:
            servos = self._plan.select(self._check)
            self._check = [servo for servo in self._check if servo not in servos]
            self._checked |= set(servos)
            return self._plan.identity(servos)
        if self._judged is not None:
            return None
        missing = self._missing
        self._tries += 1
        if self._decoder.one_by_one.active:
            return self._plan.identity_alone(missing[self._tries % len(missing)])
        # Alternate with sync reads: a servo that answers alone may only now have been switched on.
        beyond = self._tries - (TRIES if roster.servos else 1)
        if beyond > 0 and beyond % 2:
            return self._plan.identity_alone(missing[beyond // 2 % len(missing)])
        self._unanswered = self._unanswered + 1 if roster.single_answers else 0
        return self._plan.identity(missing)

    @property
    def _missing(self) -> list[int]:
        roster = self._decoder.roster
        return [servo for servo in self._decoder.everyone if servo not in roster.servos]

    @property
    def idle(self) -> bool:
        """Whether no servo has changed, and nothing must be requested or written."""
        roster = self._decoder.roster
        return (
            roster.version == self._version == self._idle_version
            and not roster.changed
            and not self._check
            and not self._refusals
        )

    def notes(self, now_ns: int) -> Iterator[bytes]:
        """Yield the notes that the decoder needs before the next request."""
        roster = self._decoder.roster
        yield from self._refusals
        self._refusals.clear()
        if roster.version == self._version and not roster.changed:
            return
        if not self._adapter_asked:
            self._adapter_asked = True
            yield from self._adapter()
        missing = self._missing
        if self._judged is None and missing:
            if self._unanswered >= max(TRIES, len(missing)):
                self._tries = self._unanswered = 0
                yield encode_note(note="one_by_one")
                return
            if not roster.servos or self._tries < self._patience(len(missing)):
                return
            yield encode_note(note="missing", servos=missing)
        now_known = {servo: identified.geometry for servo, identified in roster.servos.items()}
        is_unchanged = self._judged is not None and now_known.items() <= self._judged.items()
        self._version = roster.version
        if is_unchanged and not self._accepted_meanwhile(now_ns):
            return
        self._judged = (self._judged or {}) | now_known
        yield from self._judge()

    def _patience(self, n_missing: int) -> float:
        """Return after how many requests *n_missing* servos count as missing."""
        if self._decoder.one_by_one.active:
            return TRIES * len(self._decoder.everyone)
        if self._decoder.roster.single_answers:  # not known yet whether they know sync reads
            return math.inf
        return TRIES + 2 * n_missing  # each is asked alone once

    def _accepted_meanwhile(self, now_ns: int) -> bool:
        if not self._decoder.roster.changed or now_ns < self._look_due_ns:
            return False
        self._look_due_ns = now_ns + LOOK_EVERY_NS
        return self._memory.changed_ns() != self._remembered_ns

    def _judge(self) -> Iterator[bytes]:
        accept = self._config.accept_changed_offsets
        try:
            changed = self._memory.compare(self._decoder.roster.servos, accept)
        except BadInput as error:
            text = f"{error}; say `armd accept` once it is gone"
            yield encode_note(note="foreign", text=text)
            return
        except OSError as error:
            text = f"the servos' offsets cannot be remembered: {error}"
            yield encode_note(note="told", kind="memory", text=text, severity="warning")
            changed = {}
        self._remembered_ns = self._memory.changed_ns()
        yield encode_note(note="verdict", changed=changed)

    def _adapter(self) -> Iterator[bytes]:
        """Check the USB adapter's serial number, where the configuration has one."""
        expected = self._config.adapter_serial
        if expected is None:
            return
        device = Path(self._config.port).resolve()
        actual = next(
            (port.serial_number for port in list_ports.comports() if Path(port.device) == device),
            None,
        )
        if actual != expected:
            text = f"adapter {self._config.port}: serial number: found {actual or 'none'}, "
            yield encode_note(note="foreign", text=text + f"expected {expected}")

    def write_due(self) -> bytes | None:
        """Return the next write for [driver] torque_off or return_delay_us, if one is due.

        Each is written once; nothing else is written.
        """
        family, roster = self._decoder.family, self._decoder.roster
        if self._judged is None or roster.version == self._idle_version:
            return None
        for servo, identified in roster.servos.items():
            writes = []
            if self._config.torque_off and identified.torque:
                writes.append(("torque", int(identified.torque), 0, 0))
            delay_us = self._config.return_delay_us
            if delay_us is not None and identified.return_delay_us != delay_us:
                actual = identified.return_delay_us
                writes.append(("return_delay_us", actual, delay_us, delay_us // 2))
            for name, actual, expected, value in writes:
                register = family.registers[name]
                if (servo, register) not in self._written:
                    self._written.add((servo, register))
                    self._check = [*self._check, servo]
                    self._checked.discard(servo)
                    return family.write(servo, register, bytes([value]))
                if servo in self._checked and (servo, register) not in self._refused_writes:
                    self._refused_writes.add((servo, register))
                    text = f"{roster.name(servo)}: {family.register(name)}: found {actual}, "
                    text += f"expected {expected}: it did not keep what was written"
                    self._refusals.append(
                        encode_note(note="told", kind="write_refused", text=text, severity="error")
                    )
        if not self._check:
            self._idle_version = roster.version
        return None

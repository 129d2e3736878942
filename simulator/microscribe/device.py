"""The arm's side of the wire: waits for IMMC, answers one command at a time, at the line's pace."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from armd.arrays import I64
from armd.drivers.microscribe import wire
from armd.simulator.live.faults import Schedule
from armd.simulator.live.pty_port import PtyPort
from armd.simulator.live.scenario import Scenario
from armd.simulator.live.truth_log import FaultLog, TruthFile
from armd.simulator.microscribe import arm

TICKS_PER_S = 900
TURN_ROUND_S = 0.0002  # from a command to the first bit of its reply
SCHEDULE_HZ = 1000
_BLOCKS = {
    wire.PARAMETERS: bytes([len(arm.PARAMETERS)]) + arm.PARAMETERS,
    wire.EXTENDED: bytes([len(arm.EXTENDED)]) + arm.EXTENDED,
    wire.MAXIMA: arm.MAXIMA,
    **arm.TEXTS,
}


class MicroScribeDevice:
    """One arm on one port. *baud*: the only rate at which it hears; None: any.

    Its rows of truth are numbered by the readings it was asked for.
    """

    def __init__(
        self, scenario: Scenario, port: PtyPort, truth: TruthFile, log: FaultLog, baud: int | None
    ) -> None:
        self._scenario = scenario
        self._schedule = Schedule(scenario.fault, SCHEDULE_HZ)
        self._port = port
        self._truth = truth
        self._log = log
        self._baud = baud
        self._hand = arm.PedalHand(scenario.seed)
        self._listening: Callable[[bytes], bytes] = self._synchronise
        self._asked = 0
        self._began_ns = 0
        self._wake()

    def run(self) -> None:
        """Live for the scenario's seconds, or until interrupted."""
        self._began_ns = time.monotonic_ns()
        seconds = self._scenario.seconds
        heard = b""
        while seconds is None or self._now_s() < seconds:
            if round(self._now_s() * SCHEDULE_HZ) >= self._schedule.next_change:
                self._change_faults()
            if not self._port.plugged:
                time.sleep(0.001)
                continue
            received = self._port.read(0.01)
            if self._schedule.is_on("silence") or self._schedule.is_on("reboot"):
                self._asked += sum(byte in wire.POLLS for byte in received) * self._in_session
                heard = b""
                continue
            if self._baud is not None and received and self._port.baud != self._baud:
                heard = b""  # gibberish
                continue
            before = b"\xff" * len(heard)
            while heard + received and before != heard + received:
                before = heard + received
                heard, received = self._listening(before), b""

    def close(self) -> None:
        self._log.write("stop", at_s=self._now_s())

    # --- the session; each takes what was heard and returns what it has no use for yet ---------

    def _synchronise(self, heard: bytes) -> bytes:
        if wire.SYNC not in heard:
            return heard[-3:]
        self._reply(wire.SYNC)
        self._listening = self._begin
        return heard.rpartition(wire.SYNC)[2]

    def _begin(self, heard: bytes) -> bytes:
        if wire.BEGIN not in heard:
            return heard[-16:]
        self._reply(wire.GREETING + b"\0")
        self._listening = self._obey
        self._log.write("session", at_s=self._now_s())
        return heard.partition(wire.BEGIN)[2]

    def _obey(self, heard: bytes) -> bytes:
        command = heard[0] | 0x80
        if command == wire.END:
            self._reply(bytes([wire.END]))
            self._listening = self._synchronise
        elif command == wire.HOME:
            self._counts_at_home = arm.HOME_COUNTS.astype(np.int64)
            self._true_at_home = self._true_counts(self._now_s())
            self._hand.homed(self._now_s())
            self._reply(bytes([wire.HOME]))
            self._log.write("homed", at_s=self._now_s())
        elif command in _BLOCKS:
            self._reply(bytes([command]) + _BLOCKS[command])
        elif not command & 0x40:
            self._read(heard[0])
        return heard[1:]

    def _read(self, command: int) -> None:
        t_s = self._now_s()
        angles = self._hand.angles(t_s)
        self._truth.append(np.array([self._asked], np.uint64), arm.tip_mm(angles)[None])
        self._asked += 1
        counts = self._counts_at_home + self._true_counts(t_s) - self._true_at_home
        reading = wire.StandardReply(
            self._hand.buttons(t_s),
            int(t_s * TICKS_PER_S) & 0x3FFF,
            tuple(int(count) & 0x3FFF for count in counts),
        )
        self._reply(wire.encode_standard(command & 0x7F, reading))

    # --- the rest ----------------------------------------------------------------------------

    @property
    def _in_session(self) -> bool:
        return self._listening == self._obey

    def _wake(self) -> None:
        """Power-up: the registers are set as though the stylus were in its rest."""
        self._counts_at_home = arm.HOME_COUNTS.astype(np.int64)
        self._true_at_home = self._true_counts(self._now_s())
        self._listening = self._synchronise

    def _true_counts(self, t_s: float) -> I64:
        turns = self._hand.angles(t_s) / (2 * np.pi)
        counts: I64 = np.floor(turns * arm.COUNTS_PER_TURN + 0.5).astype(np.int64)
        return counts

    def _now_s(self) -> float:
        return (time.monotonic_ns() - self._began_ns) * 1e-9 if self._began_ns else 0.0

    def _reply(self, data: bytes) -> None:
        time.sleep(TURN_ROUND_S + len(data) * 10 / self._port.baud)
        self._port.write(data)

    def _change_faults(self) -> None:
        ended, begun = self._schedule.advance(round(self._now_s() * SCHEDULE_HZ))
        for what, faults in (("end", ended), ("begin", begun)):
            for fault in faults:
                now = {"at_s": self._now_s(), "monotonic_ns": time.monotonic_ns()}
                self._log.write(what, fault=fault.name, **now)
        if any(fault.name == "reboot" for fault in ended):
            self._wake()
        if self._schedule.is_on("unplug"):
            self._port.unplug()
        elif not self._port.plugged:
            before = self._port.path
            self._port.plug()
            if self._port.path != before:
                print(self._port.path, flush=True)

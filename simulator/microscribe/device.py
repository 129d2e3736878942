"""The arm's side of the wire: waits for IMMC, then answers commands at the line's pace."""

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
from armd.simulator.microscribe.motion import MotionReport, SpoiltPort, Timer

#: From a command to the first bit of its reply ("just under a millisecond", the maker states), and
#: to the reading, which is made as soon as the command is decoded.
TURN_ROUND_S, UNDERSTOOD_S = 0.0009, 0.0003
SCHEDULE_HZ = 1000
DEAF = ("silence", "reboot")
_BLOCKS = {
    wire.PARAMETERS: bytes([len(arm.PARAMETERS)]) + arm.PARAMETERS,
    wire.EXTENDED: bytes([len(arm.EXTENDED)]) + arm.EXTENDED,
    wire.MAXIMA: arm.MAXIMA,
    **arm.TEXTS,
}


class MicroScribeDevice:
    """One arm on one port.

    *baud*: the only rate that it receives; None: any. *hand*: a holder other than `arm.PedalHand`.
    Rows of truth are numbered by their instant (CLOCK_MONOTONIC, ns), as this wire has no number.
    """

    def __init__(
        self, scenario: Scenario, port: PtyPort, truth: TruthFile, log: FaultLog,
        baud: int | None, hand: arm.Holder | None = None,
    ) -> None:  # fmt: skip
        self._scenario = scenario
        self._schedule = Schedule(scenario.fault, SCHEDULE_HZ)
        self._port = port
        self._truth = truth
        self._log = log
        self._baud = baud
        self._hand = hand or arm.PedalHand(scenario.seed)
        self._rng = np.random.default_rng([scenario.seed, 0x35CB])
        self._listening: Callable[[bytes], bytes] = self._synchronise
        self._began_ns = 0
        self._line = SpoiltPort(port, self._rng)
        self._timer = Timer(scenario.clock_ppm, int(self._rng.integers(1 << 14)))
        self._motion: MotionReport | None = None  # the active command to respond to motion
        self._wake()

    def run(self) -> None:
        """Run for the scenario's seconds, or until interrupted."""
        self._began_ns = time.monotonic_ns()
        seconds = self._scenario.seconds
        heard = b""
        while seconds is None or self._now_s() < seconds:
            if round(self._now_s() * SCHEDULE_HZ) >= self._schedule.next_change:
                self._change_faults()
            if not self._port.plugged:
                time.sleep(0.001)
                continue
            received = self._port.read(self._respond())
            if any(self._schedule.is_on(name) for name in DEAF):
                heard = b""
                continue
            if self._baud is not None and received and self._port.baud != self._baud:
                heard = b""  # bytes at a wrong rate
                continue
            before = b"\xff" * len(heard)
            while heard + received and before != heard + received:
                before = heard + received
                heard, received = self._listening(before), b""

    def close(self) -> None:
        self._log.write("stop", at_s=self._now_s())

    # --- the session; each takes the received bytes and returns those not used yet ------------

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
        if self._motion is not None:  # any command ends it, after the packet on the line
            time.sleep(self._motion.finish(self._now_s()))
            self._motion = None
        command = heard[0] | 0x80
        if command == wire.END:
            self._reply(bytes([wire.END]))
            self._listening = self._synchronise
        elif command == wire.HOME:
            self._counts_at_home = arm.HOME_COUNTS.astype(np.int64)
            self._true_at_home = self._true_counts(self._now_s())
            self._hand.note_home(self._now_s())
            self._reply(bytes([wire.HOME]))
            self._log.write("homed", at_s=self._now_s())
        elif command == wire.RESPOND_TO_MOTION and not self._schedule.is_on("no_streaming"):
            if len(heard) < MotionReport.COMMAND_BYTES:
                return heard
            self._reply(heard[:1])
            self._motion = MotionReport(heard, self._timer, self._port.baud, self._now_s())
            return heard[MotionReport.COMMAND_BYTES :]
        elif command in _BLOCKS:
            self._reply(bytes([command]) + _BLOCKS[command])
        elif not command & 0x40:
            time.sleep(UNDERSTOOD_S)
            reading = self._read(self._now_s())
            self._reply(wire.encode_standard(command & 0x7F, reading), UNDERSTOOD_S)
        return heard[1:]

    def _respond(self) -> float:
        """Send the streamed packets that are due; return the seconds until the next."""
        motion = self._motion
        if motion is None:
            return 0.01
        if self._now_s() >= motion.due_s:
            if motion.packet:
                if not any(self._schedule.is_on(name) for name in (*DEAF, "stuck")):
                    self._line.write(motion.packet)
                motion.drop_packet()
            else:
                motion.read(self._read(motion.due_s))
        return min(0.01, max(0.0, motion.due_s - self._now_s()))

    def _read(self, t_s: float) -> wire.StandardReply:
        angles = self._hand.angles(t_s)
        at_ns = self._began_ns + round(t_s * 1e9)
        self._truth.append(np.array([at_ns], np.uint64), arm.compute_tip_mm(angles)[None])
        counts = self._counts_at_home + self._true_counts(t_s) - self._true_at_home
        return wire.StandardReply(
            self._hand.buttons(t_s),
            self._timer.ticks(t_s) & 0x3FFF,
            tuple(int(count) & 0x3FFF for count in counts),
        )

    # --- the rest ----------------------------------------------------------------------------

    def _wake(self) -> None:
        """Power up: set the registers as if the stylus were in its rest."""
        self._counts_at_home = arm.HOME_COUNTS.astype(np.int64)
        self._true_at_home = self._true_counts(self._now_s())
        self._listening = self._synchronise
        self._motion = None

    def _true_counts(self, t_s: float) -> I64:
        turns = self._hand.angles(t_s) / (2 * np.pi)
        counts: I64 = np.floor(turns * arm.COUNTS_PER_TURN + 0.5).astype(np.int64)
        return counts

    def _now_s(self) -> float:
        return (time.monotonic_ns() - self._began_ns) * 1e-9 if self._began_ns else 0.0

    def _reply(self, data: bytes, passed_s: float = 0.0) -> None:
        time.sleep(TURN_ROUND_S - passed_s + len(data) * 10 / self._port.baud)
        self._line.write(data)

    def _change_faults(self) -> None:
        ended, begun = self._schedule.advance(round(self._now_s() * SCHEDULE_HZ))
        for change, faults in (("end", ended), ("begin", begun)):
            for fault in faults:
                now = {"at_s": self._now_s(), "monotonic_ns": time.monotonic_ns()}
                self._log.write(change, fault=fault.name, **now)
                self._line.fault(fault, change == "begin")
        if any(fault.name == "reboot" for fault in ended):
            self._timer = self._timer.restarted(self._now_s())
            self._wake()
        if self._schedule.is_on("unplug"):
            self._port.unplug()
        elif not self._port.plugged:
            before = self._port.path
            self._port.plug()
            if self._port.path != before:
                print(self._port.path, flush=True)

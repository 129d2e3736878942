"""The servos' side of the line: answers of each servo in its slot, at the line's true pace."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from armd.arrays import F64
from armd.drivers.poll.protocol import dynamixel, dynamixel1, feetech
from armd.drivers.poll.protocol.packet import BROADCAST, Packet, Status
from armd.simulator.live.faults import Fault, Schedule
from armd.simulator.live.pty_port import PtyPort, measure_transit_ns
from armd.simulator.live.scenario import Scenario
from armd.simulator.live.truth_log import FaultLog, TruthFile
from armd.simulator.servobus.arm import N, ServoArm
from armd.simulator.servobus.servo import AX_12, MX_28, SimulatedServo

if TYPE_CHECKING:
    from armd.simulator.live.led import Led

SCHEDULE_HZ = 1000
TRUTH_HZ = 500
CODECS = {"feetech": feetech, "dynamixel": dynamixel, "dynamixel1": dynamixel1}
#: the least pause before each answer
TURN_ROUND_NS = {"feetech": 50_000, "dynamixel": 40_000, "dynamixel1": 40_000}
AWAKE_NS = 60_000  # busy-wait before the last answer, as sleep is inexact by this
LATE_NS = 100_000  # largest lateness of a write within its slot
MUTE = ("silence", "reboot")
GARBAGE = b"\xff\xff\x01\xff\xff\xfd\x00\x02\xff"


class ServoBus:
    """All servos on one port, from power-up until `run` returns.

    Rows of truth are numbered by their instant (CLOCK_MONOTONIC, ns), as a servo line has no number
    of its own.
    """

    def __init__(
        self, family: str, scenario: Scenario, port: PtyPort, truth: TruthFile, log: FaultLog,
        baud: int | None, led: Led | None = None,
    ) -> None:  # fmt: skip
        """Make the bus; *led*: the plan of the hand, or None; *baud*: the only rate received."""
        self._codec = CODECS[family]
        self._is_short = family != "dynamixel"  # addresses have one byte, a pong has no model
        self._turn_round_ns = TURN_ROUND_NS[family]
        self._scenario = scenario
        self._schedule = Schedule(scenario.fault, SCHEDULE_HZ)
        self._port, self._truth, self._log, self._baud = port, truth, log, baud
        within_s = scenario.warm_up_s or scenario.seconds or 20.0
        self._arm = ServoArm(
            scenario.seed, scenario.ambient_c, scenario.warm_up_k, within_s, led,
            scenario.joints or N,
        )  # fmt: skip
        self._rng = np.random.default_rng([scenario.seed, 0x5EB0])
        # In protocol 1.0 the last joint and the gripper are AX-12, the others MX-28.
        old = self._arm.ids[-2:]
        self._servos = {
            n: SimulatedServo(n, family, model=AX_12 if n in old else MX_28) for n in self._arm.ids
        }
        self._splitter = self._codec.make_splitter()
        self._once: list[Fault] = []  # faults of one cycle that are still to come
        self._late_status = b""  # an answer to send one cycle late
        self._byte_ns = 0.0
        self._transit_ns = measure_transit_ns()  # subtracted, as a wire has none
        self._began_ns = time.monotonic_ns()
        self._warm_step, self._warm = -1, np.empty(0)
        self._told_s = 0.0  # time up to which the truth is written

    def run(self) -> None:
        """Run for the scenario's seconds, or until interrupted."""
        self._began_ns = time.monotonic_ns()
        self._log.write("boot", monotonic_ns=self._began_ns, servos=list(self._arm.ids))
        seconds = self._scenario.seconds
        while seconds is None or self._now_s() < seconds:
            if round(self._now_s() * SCHEDULE_HZ) >= self._schedule.next_change:
                self._change_faults()
            if not self._port.plugged:
                time.sleep(0.001)
                continue
            received = self._port.read(0.005)
            if not received:
                continue
            arrived_ns = time.monotonic_ns() - self._transit_ns
            baud = self._port.baud
            if self._baud is not None and baud != self._baud:
                self._splitter.flush()  # bytes at a wrong rate
                continue
            self._byte_ns = 1e10 / baud
            if self._schedule.is_on("echo"):
                self._port.write(received)
            for packet in self._splitter.push(received):
                if not any(self._schedule.is_on(name) for name in MUTE):
                    self._obey(packet, arrived_ns + len(packet.raw) * self._byte_ns)

    def close(self) -> None:
        """Write the truth up to now, and finish the fault log."""
        until_s = min(self._now_s(), self._scenario.seconds or float("inf"))
        time_s = np.arange(self._told_s, until_s, 1 / TRUTH_HZ)
        for part in np.array_split(time_s, max(1, len(time_s) // 2000)):
            if len(part):
                instants = self._began_ns + np.round(part * 1e9).astype(np.uint64)
                self._truth.append(instants.astype(np.uint64), self._arm.tips_mm(part))
        self._told_s = until_s
        self._log.write("stop", **self._read_clocks())

    # --- answers ------------------------------------------------------------------------------

    def _obey(self, packet: Packet, heard_ns: float) -> None:
        """Answer a packet whose last bit came at *heard_ns*."""
        codec = self._codec
        request = codec.decode_read_request(packet)
        if request is not None:
            self._read(request.ids, request.address, request.length, request.fast, heard_ns,
                       to_one_servo=packet.id in self._servos)  # fmt: skip
        elif packet.code == codec.PING:
            pinged_ids = self._arm.ids if packet.id == BROADCAST else (packet.id,)
            for n in pinged_ids:
                if n in self._servos:
                    heard_ns = self._say(self._pong(n), heard_ns, n)
        elif packet.code == codec.WRITE and packet.id in self._servos:
            address, data = packet.params[0], packet.params[1:]
            if not self._is_short:
                address, data = address | packet.params[1] << 8, packet.params[2:]
            error = self._servos[packet.id].write(address, data)
            self._log.write("write", servo=packet.id, address=address, data=list(data))
            self._say(codec.make_status(packet.id, error), heard_ns, packet.id)

    def _pong(self, n: int) -> bytes:
        servo = self._servos[n]
        data = b"" if self._is_short else servo.read(0, 2) + servo.read(6, 1)
        status: bytes = self._codec.make_status(n, servo.error, data)
        return status

    def _read(
        self, ids: tuple[int, ...], address: int, length: int, fast: bool, heard_ns: float,
        to_one_servo: bool,
    ) -> None:  # fmt: skip
        is_cycle = address == self._servos[self._arm.ids[0]].registers.position
        is_cycle &= not to_one_servo or self._codec is dynamixel1  # it has no sync read
        once = []
        if is_cycle:
            once = [f for f in self._once if not to_one_servo or f.joint in ids]
            self._once = [f for f in self._once if f not in once]
        faults = [*self._schedule.active, *once]
        if any(fault.name == "stale_bytes" for fault in faults):
            self._port.write(GARBAGE)
        if fast:
            self._answer_fast(ids, address, length, heard_ns, faults)
            return
        end_ns = heard_ns
        for n in ids:
            servo = self._servos.get(n)
            if servo is None or _silent(n, faults):
                continue
            begin_ns = end_ns + self._gap_ns(servo)
            self._feel(servo, begin_ns, faults)
            status = self._codec.make_status(n, servo.error, servo.read(address, length))
            if is_cycle and any(f.name == "late_answer" and f.joint == n for f in once):
                self._late_status = status
                continue
            if _flips(n, faults):
                status = self._flip(status, -3)
            end_ns = self._say(status, end_ns, n, last=n == ids[-1])
            if self._late_status and is_cycle and not once:
                self._port.write(self._late_status)
                self._late_status = b""

    def _answer_fast(
        self, ids: tuple[int, ...], address: int, length: int, heard_ns: float, faults: list[Fault]
    ) -> None:
        """Answer in one packet of all; a silent servo ends it."""
        answers: list[Status | None] = []
        at_ns = heard_ns + self._turn_round_ns + 8 * self._byte_ns
        for n in ids:
            servo = self._servos.get(n)
            if servo is None or _silent(n, faults):
                answers.append(None)
                continue
            self._feel(servo, at_ns, faults)
            answers.append(Status(n, servo.error, servo.read(address, length)))
            at_ns += (4 + length) * self._byte_ns
        answers_before_gap = answers[: answers.index(None)] if None in answers else answers
        padded_answers = [
            a or Status(n, 0, bytes(length)) for a, n in zip(answers, ids, strict=True)
        ]
        blocks = dynamixel.make_fast_status_blocks(
            padded_answers, lambda n, block: self._flip(block, -1) if _flips(n, faults) else block
        )[: len(answers_before_gap)]
        if blocks:
            data = b"".join(blocks)
            self._say(data, heard_ns, ids[0], last=True)

    def _flip(self, data: bytes, position: int) -> bytes:
        spoilt = bytearray(data)
        spoilt[position] ^= 1 << int(self._rng.integers(8))
        return bytes(spoilt)

    def _gap_ns(self, servo: SimulatedServo) -> float:
        return max(self._turn_round_ns, 2000 * servo.table[servo.registers.return_delay])

    def _say(self, status: bytes, free_ns: float, n: int, last: bool = False) -> float:
        """Send a status once the line is free; return the true instant of its last bit."""
        end_ns = free_ns + self._gap_ns(self._servos[n]) + len(status) * self._byte_ns
        wait_ns = end_ns - time.monotonic_ns() - (AWAKE_NS if last else 0)
        if wait_ns > 0:
            time.sleep(wait_ns * 1e-9)
        while last and time.monotonic_ns() < end_ns:
            pass
        self._port.write(status)
        return max(end_ns, time.monotonic_ns() - LATE_NS)

    def _feel(self, servo: SimulatedServo, at_ns: float, faults: list[Fault]) -> None:
        """Let the servo sample."""
        time_s = (at_ns - self._began_ns) * 1e-9
        raw = self._arm.raw(servo.id, time_s)
        celsius = float(self._celsius(time_s)[servo.id - 1])
        runs_on = False
        for fault in faults:
            if fault.joint == servo.id:
                raw += round(fault.size) if fault.name == "count_jump" else 0
                celsius += fault.size if fault.name == "temperature_step" else 0.0
                runs_on |= fault.name == "multi_turn"
        servo.feel(raw - 4096 if runs_on else raw, celsius, time_s, runs_on)

    def _celsius(self, time_s: float) -> F64:
        """Return the temperatures of all servos, computed ten times a second."""
        step = int(time_s * 10)
        if step != self._warm_step:
            self._warm_step = step
            self._warm = self._arm.warmth.celsius_at(np.array([time_s]))[0]
        return self._warm

    # --- faults -------------------------------------------------------------------------------

    def _change_faults(self) -> None:
        ended, begun = self._schedule.advance(round(self._now_s() * SCHEDULE_HZ))
        for fault in ended:
            self._lasting(fault, False)
            self._log.write("end", fault=fault.name, **self._read_clocks())
        for fault in begun:
            self._lasting(fault, True)
            if fault.seconds == 0.0:
                self._once.append(fault)
            self._log.begin(fault, **self._read_clocks())
        self._schedule.active = [fault for fault in self._schedule.active if fault.seconds > 0.0]

    def _lasting(self, fault: Fault, on: bool) -> None:
        servo = self._servos[min(fault.joint, len(self._servos))]
        match fault.name:
            case "unplug" if on:
                self._port.unplug()
            case "unplug":
                before = self._port.path
                self._port.plug()
                if self._port.path != before:
                    print(self._port.path, flush=True)
            case "torque_on":
                servo.table[servo.registers.torque] = int(on)
            case "mixed_firmware":
                step = round(fault.size) if on else -round(fault.size)
                servo.table[servo.registers.firmware] += step
            case "servo_silent" if on:
                servo.start_anew()
            case "reboot" if on:
                for rebooted_servo in self._servos.values():
                    rebooted_servo.start_anew()
            case "servo_alert":
                servo.alert(on)
            case "homing_changed":
                servo.set_homing(round(fault.size) if on else 0)

    def _now_s(self) -> float:
        return (time.monotonic_ns() - self._began_ns) * 1e-9

    def _read_clocks(self) -> dict[str, int | float]:
        return {"at_s": self._now_s(), "monotonic_ns": time.monotonic_ns()}


def _flips(servo: int, faults: list[Fault]) -> bool:
    return any(fault.name == "flipped_bit" and fault.joint == servo for fault in faults)


def _silent(servo: int, faults: list[Fault]) -> bool:
    names = ("joint_invalid", "servo_silent", "missing_answer")
    return any(fault.name in names and fault.joint == servo for fault in faults)

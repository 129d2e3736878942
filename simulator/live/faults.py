"""The faults of an arm on a wire, by name and time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, field_validator

from armd.errors import ArmdError, BadInput
from armd.files.schema import Strict, validate

Wire = Literal["serial", "can", "microscribe", "servo"]


#: The most random faults of one run: one a minute for a week.
MOST_RANDOM = 10_000


class FaultKind(NamedTuple):
    """A kind of fault: its effect, its usual duration and amount, and its wires.

    A duration of 0 s is one latch: one packet, one cycle.
    """

    text: str
    duration_s: float
    wires: tuple[Wire, ...]
    amount: float = 0.0


SERIAL: tuple[Wire, ...] = ("serial",)
CAN: tuple[Wire, ...] = ("can",)
PORTS: tuple[Wire, ...] = ("serial", "microscribe", "servo")
BOTH: tuple[Wire, ...] = ("serial", "can")
ALL: tuple[Wire, ...] = ("serial", "can", "microscribe", "servo")
JOINTS: tuple[Wire, ...] = ("serial", "can", "servo")
SERVO: tuple[Wire, ...] = ("servo",)
SCRIBE: tuple[Wire, ...] = ("microscribe",)

FAULTS = {
    "corrupted_byte": FaultKind("one byte of the SAMPLE packet changes on the wire", 0.0, SERIAL),
    "truncated_packet": FaultKind(
        "the SAMPLE packet loses its end, delimiter included", 0.0, SERIAL
    ),
    "lost_samples": FaultKind("SAMPLE packets are not sent; seq counts on", 0.005, SERIAL),
    "repeated_packet": FaultKind("the SAMPLE packet is sent twice", 0.0, SERIAL),
    "silence": FaultKind("nothing is sent or answered; the arm keeps its state", 0.8, ALL),
    "unplug": FaultKind("the port disappears, and comes back at the end", 1.0, PORTS),
    "reboot": FaultKind("the arm starts anew: counters, clock, boot_id, settings", 0.3, ALL),
    "lost_byte": FaultKind("a packet loses `amount` bytes, from any place on", 0.0, SCRIBE, 1),
    "inserted_byte": FaultKind("`amount` bytes come into a packet, at any place", 0.0, SCRIBE, 1),
    "stuck": FaultKind("nothing is streamed; the arm answers what it is asked", 1.0, SCRIBE),
    "no_streaming": FaultKind("the arm does not know the command to stream (CF)", 1e9, SCRIBE),
    "joint_invalid": FaultKind(
        "the joint's status bit is set (CAN: an alarm; servo: no answer)", 0.5, JOINTS
    ),
    "count_jump": FaultKind(  # not a whole turn on any wire
        "the joint's count is off by `amount` counts", 0.0, JOINTS, 450_000
    ),
    "sensor_open": FaultKind("the channel is marked invalid", 3.0, BOTH),
    "sensor_silent": FaultKind("no temperatures are sent", 6.0, BOTH),
    "temperature_step": FaultKind("the channel reads `amount` kelvin more", 5.0, JOINTS, 5.0),
    "joint_warning": FaultKind("the joint's node reports a warning (6505)", 0.5, CAN),
    "emcy": FaultKind(
        "the joint's node sends an emergency, and takes it back at the end", 0.5, CAN
    ),
    "heartbeat_loss": FaultKind("the joint's node sends its TPDOs, but no heartbeat", 2.0, CAN),
    "node_silent": FaultKind("the joint's node neither hears nor speaks", 1.0, CAN),
    "node_reboot": FaultKind("the joint's node starts anew with factory settings", 0.3, CAN),
    "missing_tpdo": FaultKind("the joint's node does not answer a SYNC", 0.0, CAN),
    "bus_down": FaultKind("the bus is gone, and comes back at the end", 1.0, CAN),
    "missing_answer": FaultKind("the joint's servo does not answer one request", 0.0, SERVO),
    "late_answer": FaultKind("the joint's servo answers in the cycle after", 0.0, SERVO),
    "flipped_bit": FaultKind(
        "one bit of the servo's answer changes, its length does not", 0.0, SERVO
    ),
    "stale_bytes": FaultKind("bytes that are no answer come before the answers", 0.0, SERVO),
    "echo": FaultKind("the adapter hears what the host says", 1.0, SERVO),
    "servo_silent": FaultKind("the joint's servo starts anew, and is silent till then", 1.2, SERVO),
    "multi_turn": FaultKind("the servo's positions run on over the turns, below 0", 1.0, SERVO),
    "torque_on": FaultKind("the servo's torque is on", 5.0, SERVO),
    "servo_alert": FaultKind("the servo complains of overload; its data hold", 1.0, SERVO),
    "mixed_firmware": FaultKind(
        "the servo's firmware is `amount` versions ahead of the others'", 10.0, SERVO, 1
    ),
    "homing_changed": FaultKind(
        "another tool changed the servo's homing offset by `amount` counts", 2.0, SERVO, 120
    ),
}


class Fault(Strict):
    """One fault of one run; times are seconds since the simulator started.

    Duration and amount are the kind's own where they are None.
    """

    name: str
    at_s: Annotated[float, Field(ge=0)]
    duration_s: Annotated[float, Field(ge=0)] | None = None
    amount: float | None = None
    joint: Annotated[int, Field(ge=1)] = 2  # or servo
    channel: Annotated[int, Field(ge=1)] = 2

    @field_validator("name")
    @classmethod
    def _check_name(cls, name: str) -> str:
        if name not in FAULTS:
            raise ValueError(f"one of {', '.join(FAULTS)}")
        return name

    @property
    def seconds(self) -> float:
        return FAULTS[self.name].duration_s if self.duration_s is None else self.duration_s

    @property
    def size(self) -> float:
        return FAULTS[self.name].amount if self.amount is None else self.amount

    def latches(self, rate_hz: int) -> range:
        """Return the latches that it covers, counted from the simulator's start: at least one."""
        first = round(self.at_s * rate_hz)
        return range(first, first + max(1, round(self.seconds * rate_hz)))


def parse_fault(text: str) -> Fault:
    """Parse `NAME@SECONDS[:DURATION]` of the command line; raises `BadInput`."""
    name, _, times_text = text.partition("@")
    begin_text, _, duration = times_text.partition(":")
    try:
        times = {"at_s": float(begin_text)} | ({"duration_s": float(duration)} if duration else {})
    except ValueError:
        raise BadInput("command line", "--fault", text, "NAME@SECONDS[:DURATION]") from None
    return validate(f"--fault {text}", {"name": name, **times}, Fault)


def check_wire(faults: Sequence[Fault], wire: Wire, joints: int) -> None:
    """Raise `BadInput` for a fault that this wire does not have.

    Also for a joint (a servo, a channel) that an arm with so many *joints* (servos) lacks.
    """
    for fault in faults:
        for key, k in (("joint", fault.joint), ("channel", fault.channel)):
            if k > joints:
                raise BadInput("simulator", f"fault {fault.name}: {key}", str(k), f"1 to {joints}")
        if wire not in FAULTS[fault.name].wires:
            names = [name for name, kind in FAULTS.items() if wire in kind.wires]
            raise BadInput(
                "simulator", f"faults of {wire}", fault.name, f"one of {', '.join(names)}"
            )


def draw_faults(
    seed: int, per_minute: float, seconds: float, wire: Wire, joints: int
) -> list[Fault]:
    """Draw faults of all kinds at random times, places and lengths, the same for the same seed.

    Successive faults are at least 2 s apart, so that each recovery is separate from the next loss.
    The first 5 s and the last 3 s have none. Raises `ArmdError` for more than MOST_RANDOM.
    """
    if per_minute * seconds / 60.0 > MOST_RANDOM:
        actual = f"faults_per_minute: found {per_minute:g} for {seconds:g} s"
        raise ArmdError(f"{actual}, expected {MOST_RANDOM} faults at most")
    rng = np.random.default_rng([seed, 0xFA17])
    names = [name for name, kind in FAULTS.items() if wire in kind.wires]
    faults: list[Fault] = []
    pause_s = max(60.0 / per_minute - 2.0, 0.0)
    at_s = 5.0
    while True:
        at_s += rng.exponential(pause_s)
        name = str(rng.choice(names))
        duration_s = FAULTS[name].duration_s * rng.uniform(0.5, 1.5)
        if at_s + duration_s > seconds - 3.0:
            return faults
        joint, channel = rng.integers(1, joints + 1, 2)
        faults.append(
            Fault(
                name=name,
                at_s=round(at_s, 3),
                duration_s=round(duration_s, 3),
                joint=int(joint),
                channel=int(channel),
            )
        )
        at_s += duration_s + 2.0


class Schedule:
    """The active faults, latch by latch."""

    def __init__(self, faults: Sequence[Fault], rate_hz: int) -> None:
        self._waiting = [(fault.latches(rate_hz), fault) for fault in faults]
        self._on: list[tuple[range, Fault]] = []
        self.active: list[Fault] = []
        self.next_change = self._next_change()

    def is_on(self, name: str) -> bool:
        return any(fault.name == name for fault in self.active)

    def advance(self, latch: int) -> tuple[list[Fault], list[Fault]]:
        """Return faults that end and faults that begin by this latch; call it at `next_change`."""
        ended = [fault for latches, fault in self._on if latches.stop <= latch]
        begun = [fault for latches, fault in self._waiting if latches.start <= latch]
        self._on = [(latches, fault) for latches, fault in self._on if latches.stop > latch]
        self._on += [(latches, fault) for latches, fault in self._waiting if fault in begun]
        self._waiting = [item for item in self._waiting if item[1] not in begun]
        self.active = [fault for _, fault in self._on]
        self.next_change = self._next_change()
        return ended, begun

    def _next_change(self) -> int:
        changes = [latches.start for latches, _ in self._waiting]
        changes += [latches.stop for latches, _ in self._on]
        return min(changes, default=1 << 62)

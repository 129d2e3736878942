"""Raw frames of a MicroScribe's line → samples and events. No port, no clock of its own.

The arm has a timer of 1.1 ms and no clock. A reading's instant is taken for the middle between
the end of its request and the beginning of its reply, which is where it must lie.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from armd.drivers.identity import Expectation
from armd.drivers.joint_watch import JointWatch
from armd.drivers.microscribe import wire
from armd.drivers.microscribe.conversation import Conversation, Phase
from armd.drivers.microscribe.homing import Homing
from armd.drivers.sample import Event, Item, RawFrame, sample_dtype
from armd.drivers.unwrap import MAX_JOINT_RATE_DEG_S, Unwrapper

UP, SEQ, HOMED = b"up ", b"seq ", b"homed"  # "link" frames: the baud rate; a recording's begin
PUT_IT_TO_REST = "put the stylus into its rest and press a pedal"


class MicroScribeDecoder:
    """Feed it every `RawFrame` of the line in order, sent ones too."""

    def __init__(
        self, expectation: Expectation, max_joint_rate_deg_s: float = MAX_JOINT_RATE_DEG_S
    ) -> None:
        self.conversation = Conversation()
        self.accepted = False  # whether the connected arm is the expected one
        self.homing: Homing | None = None  # of an accepted arm
        self.last_sample_ns: int | None = None  # arrival of the last reading, host monotonic
        self._expected = expectation
        self._max_rate = max_joint_rate_deg_s
        self._dtype = sample_dtype(expectation.n_joints)
        self._baud = wire.BAUDS[0]
        self._serial_number = ""
        self._unwrapper: Unwrapper | None = None
        self._jumps = JointWatch("count_jump", "its count jumped")
        self._seq = -1  # of the last cycle
        self._delivered = -1  # seq of the last sample
        self._greeting: list[RawFrame] = []  # what told whose arm this is
        self._counted: Counter[str] = Counter()

    @property
    def counters(self) -> dict[str, int]:
        """Samples, and what was asked for or came without becoming one."""
        names = ("samples", "lost", "foreign")
        return {name: self._counted[name] for name in names} | {
            "malformed": self.conversation.malformed
        }

    def preamble(self) -> list[RawFrame]:
        """What a fresh decoder must be fed to go on from here."""
        if not self.accepted or self.homing is None:
            return []
        first = self._greeting[0]._replace(direction="link", data=UP + b"%d" % self._baud)
        frames = [first, first._replace(data=SEQ + b"%d" % self._seq), *self._greeting]
        return [*frames, first._replace(data=HOMED)] if self.homing.homed else frames

    def warm_up(self) -> None:
        """Compile, or load from the cache: before the first sample, not while it waits."""
        self._new_unwrapper([4096] * self._expected.n_joints)(
            np.zeros((1, self._expected.n_joints), np.int64), np.zeros(1, np.int64),
            np.zeros(1, np.uint16),
        )  # fmt: skip

    def feed(self, frame: RawFrame) -> list[Item]:
        """What *frame* completes, in the order of the wire."""
        if frame.direction == "link":
            self._link(frame.data)
            return []
        if frame.direction == "tx":
            items = [
                i for reply in self.conversation.sent(frame) for i in self._reply(*reply, frame)
            ]
            # Not a cycle: HOME, and what is asked of an arm whose samples nobody wants.
            if self.accepted and frame.data[0] in wire.POLLS:
                self._seq += 1
            return items
        return [
            i for reply in self.conversation.received(frame) for i in self._reply(*reply, frame)
        ]

    def _link(self, data: bytes) -> None:
        if data.startswith(SEQ):
            self._seq = self._delivered = int(data.removeprefix(SEQ))
            self.conversation.phase = Phase.SERIAL_NUMBER
        elif data == HOMED:
            if self.homing is not None:
                self.homing.acknowledged()
        else:
            if data.startswith(UP):
                self._baud = int(data.removeprefix(UP))
            self.conversation.restart()
            self.accepted, self.homing = False, None

    # --- replies -------------------------------------------------------------------------

    def _reply(self, packet: bytes, request: RawFrame, frame: RawFrame) -> list[Item]:
        command = packet[0] | 0x80
        if command == wire.SERIAL_NUMBER:
            self._serial_number = wire.text(packet)
            self._greeting = [request, frame._replace(direction="rx", data=packet)]
            return []
        if command == wire.MAXIMA:
            self._greeting += [request, frame._replace(direction="rx", data=packet)]
            return self._greet(wire.counts_per_turn(packet), frame)
        if command == wire.HOME:
            return self._homed(frame)
        self.last_sample_ns = frame.monotonic_ns
        if not self.accepted or self.homing is None:
            self._counted["foreign"] += 1
            return []
        return self._sample(packet, request, frame, self.homing)

    def _greet(self, counts_per_turn: tuple[int, ...], frame: RawFrame) -> list[Item]:
        at_ns = frame.monotonic_ns
        faults = self._expected.mismatches(
            self._serial_number, len(counts_per_turn), counts_per_turn
        )
        self.accepted = not faults
        if faults:
            text = f"a foreign arm is connected: {'; '.join(faults)}"
            return [Event("foreign_arm", text, at_ns, "error", {"faults": faults})]
        self.homing = Homing(counts_per_turn)
        self._unwrapper = self._new_unwrapper(counts_per_turn)
        text = f"MicroScribe {self._serial_number} identified, at {self._baud} baud"
        detail = {"serial_number": self._serial_number, "baud": self._baud}
        return [
            Event("identified", text, at_ns, "info", detail),
            Event("not_homed", f"the arm is not homed: {PUT_IT_TO_REST}", at_ns),
        ]

    def _homed(self, frame: RawFrame) -> list[Item]:
        if self.homing is None or self.homing.homed or self._unwrapper is None:
            return []
        self.homing.acknowledged()
        self._unwrapper.restart()
        return [Event("homed", "the arm is homed", frame.monotonic_ns, "info")]

    def _new_unwrapper(self, counts_per_turn: list[int] | tuple[int, ...]) -> Unwrapper:
        return Unwrapper(counts_per_turn, counts_per_turn, self._max_rate)

    # --- samples -------------------------------------------------------------------------

    def _sample(
        self, packet: bytes, request: RawFrame, frame: RawFrame, homing: Homing
    ) -> list[Item]:
        reading = wire.decode_standard(packet)
        counts = reading.counts[: wire.N_JOINTS]
        at_ns = self._instant_ns(request, frame, len(packet))
        items: list[Item] = []
        if not homing.homed:
            refused = homing.watch(counts, reading.buttons, at_ns)
            if refused:
                text = f"the arm stays unhomed, as {refused}: {PUT_IT_TO_REST}"
                items.append(Event("home_refused", text, frame.monotonic_ns))
        assert self._unwrapper is not None
        sample = np.zeros(1, self._dtype)
        every = (1 << len(counts)) - 1
        withheld = np.array([0 if homing.homed else every], np.uint16)
        sample["count"], jumped = self._unwrapper(
            np.array([counts], np.int64), np.array([at_ns // 1000]), withheld
        )
        sample["seq"] = self._seq
        sample["device_ns"] = sample["monotonic_ns"] = at_ns
        sample["stamp_ns"] = at_ns + frame.unix_ns - frame.monotonic_ns
        sample["joint_invalid"] = withheld | jumped
        sample["buttons"] = reading.buttons
        sample["clock_mapped"] = True
        gap = self._seq - self._delivered - 1
        sample["lost_before"] = self._delivered >= 0 and gap > 0
        self._counted["lost"] += gap if self._delivered >= 0 else 0
        self._delivered = self._seq
        self._counted["samples"] += 1
        return [*items, *self._jumps.events(sample, jumped), sample]

    def _instant_ns(self, request: RawFrame, reply: RawFrame, size: int) -> int:
        """The middle between the request's last bit and the reply's first one; the bytes' own
        time on the line is known."""
        byte_ns = 10_000_000_000 // self._baud
        begin = request.monotonic_ns + len(request.data) * byte_ns
        end = reply.monotonic_ns - size * byte_ns
        if end < begin:  # a line without pace
            begin, end = request.monotonic_ns, reply.monotonic_ns
        return (begin + end) // 2

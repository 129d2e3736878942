"""Decodes raw frames of a MicroScribe's line to samples and events, without port or clock."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np

from armd.drivers.identity import Expectation
from armd.drivers.joint_watch import JointWatch
from armd.drivers.microscribe import wire
from armd.drivers.microscribe.conversation import ATTEMPTS, Conversation, Phase
from armd.drivers.microscribe.homing import LIFT_IT, Before, Homing
from armd.drivers.microscribe.instants import ReadingInstants
from armd.drivers.microscribe.stream import PacketStream, Streamed
from armd.drivers.microscribe.timer import TICK_NS
from armd.drivers.sample import Event, Item, RawFrame, sample_dtype
from armd.drivers.unwrap import MAX_JOINT_RATE_DEG_S, Unwrapper

UP, SEQ, HOMED = b"up ", b"seq ", b"homed"  # "link" frames: baud rate; a recording's begin
TIMED = b"timed "  # beginning of a recording: timer, homing, and an active stream
POLLS_BEFORE = 4  # readings requested before it streams again: each bounds the timer
PUT_IT_TO_REST = "put the stylus into its rest and press a pedal"


class MicroScribeDecoder:
    """Decodes every `RawFrame` of the line in order, sent ones too."""

    def __init__(
        self,
        expectation: Expectation,
        max_joint_rate_deg_s: float = MAX_JOINT_RATE_DEG_S,
        stream: bool = True,
    ) -> None:
        """Take the expected arm; *stream*: let the arm send its readings by itself, if it can."""
        self.conversation = Conversation()
        self.accepted = False  # whether the connected arm is the expected one
        self.homing: Homing | None = None  # state of an accepted arm
        self._before: Before | None = None  # state before a homing was lost
        self.last_sample_ns: int | None = None  # arrival of the last reading, host monotonic
        self._expected = expectation
        self._max_rate = max_joint_rate_deg_s
        self._dtype = sample_dtype(expectation.n_joints)
        self._serial_number = ""
        self._unwrapper: Unwrapper | None = None
        self._jumps = JointWatch("count_jump", "its count jumped", "it jumps no more")
        self._stream = stream
        self._instants = ReadingInstants()
        self._streaming_state = ""  # the last event about streaming in this session
        self._seq = -1  # seq of the last cycle
        self._delivered = -1  # seq of the last sample
        self._greeting: list[RawFrame] = []  # the frames that identified the arm
        self._counted: Counter[str] = Counter()

    @property
    def counters(self) -> dict[str, int]:
        """The number of samples, and of requested or received packets that became none."""
        names = ("samples", "streamed", "lost", "foreign")
        return {name: self._counted[name] for name in names} | {
            "malformed": self.conversation.malformed + self._counted["misplaced"]
        }

    @property
    def may_stream(self) -> bool:
        """Whether the command to stream should be sent now."""
        homed = self.accepted and self.homing is not None and self.homing.homed
        bounded = self._instants.timer.mapped and self.conversation.polled >= POLLS_BEFORE
        return self._stream and homed and bounded and not self._hindrance

    @property
    def _hindrance(self) -> str:
        """The reason why this arm cannot stream; empty if it can."""
        if self.conversation.failures >= ATTEMPTS:
            return "it does not follow the command to stream (CF)"
        if self.conversation.unstopped >= ATTEMPTS:
            return "it does not answer the command that ends streaming (00)"
        if not self.conversation.timed:
            return "it does not tell its timer"
        return "its timer does not run at 900 Hz" if self._instants.timer.hopeless else ""

    def preamble(self) -> list[RawFrame]:
        """Return the frames from which a fresh decoder continues."""
        if not self.accepted or self.homing is None:
            return []
        first = self._greeting[0]._replace(direction="link", data=UP + b"%d" % self._instants.baud)
        frames = [first, first._replace(data=SEQ + b"%d" % self._seq), *self._greeting]
        if self.homing.homed:
            frames.append(first._replace(data=HOMED))
        stream = self.conversation.stream
        streaming = [self._streaming_state, self._instants.state(), stream and stream.state()]
        state = [*streaming, self.homing.state()]
        return [*frames, first._replace(data=TIMED + json.dumps(state).encode())]

    def warm_up(self) -> None:
        """Compile the decoder, or load it from the cache, before the first sample arrives."""
        self._new_unwrapper([4096] * self._expected.n_joints)(
            np.zeros((1, self._expected.n_joints), np.int64), np.zeros(1, np.int64),
            np.zeros(1, np.uint16),
        )  # fmt: skip

    def feed(self, frame: RawFrame) -> list[Item]:
        """Decode *frame*; return the items that it completes, in the order of the wire."""
        if frame.direction == "link":
            self._link(frame.data)
            return []
        if frame.direction == "tx":
            items = [
                i for reply in self.conversation.sent(frame) for i in self._reply(*reply, frame)
            ]
            items += self._whether_it_streams(frame)
            if self.homing is not None and frame.data[0] == wire.HOME:
                self.homing.note_sent()
            # HOME is no cycle; nor are requests to an arm that is not accepted.
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
        elif data.startswith(TIMED):
            state = json.loads(data.removeprefix(TIMED))
            self._streaming_state, instants, stream, *homing = state
            self._instants.restore(instants)
            if homing:  # an older recording has none
                self.homing = Homing.restored(homing[0])
            if stream is not None:
                self.conversation.resume(PacketStream.restored(stream))
        else:
            if data.startswith(UP):
                self._instants.baud = int(data.removeprefix(UP))
            self.conversation.restart()
            if self.homing is not None:
                self._before = self.homing.lost()
            self.accepted, self.homing = False, None
            self._instants.restart()
            self._streaming_state = ""

    # --- replies -------------------------------------------------------------------------

    def _reply(self, packet: bytes, request: RawFrame | Streamed, frame: RawFrame) -> list[Item]:
        if isinstance(request, Streamed):
            return self._streamed(request)
        command = packet[0] | 0x80
        if command == wire.SERIAL_NUMBER:
            self._serial_number = wire.decode_text(packet)
            self._greeting = [request, frame._replace(direction="rx", data=packet)]
            return []
        if command == wire.MAXIMA:
            self._greeting += [request, frame._replace(direction="rx", data=packet)]
            return self._greet(wire.decode_counts_per_turn(packet), frame)
        if command == wire.HOME:
            return self._homed(frame)
        if command == wire.STOP[0] | wire.MARK:
            return []
        self.last_sample_ns = frame.monotonic_ns
        if not self.accepted or self.homing is None:
            self._counted["foreign"] += 1
            return []
        reading = wire.decode_standard(packet)
        maps = self._stream and self.homing.homed and not self._hindrance
        at_ns, holds = self._instants.estimate_instant(
            request, frame, len(packet), reading.ticks, maps
        )
        if self._seq == self._delivered + 1:
            self._seq += self._instants.missing(at_ns)
        self._instants.stream_ended()
        took_ns = frame.monotonic_ns - request.monotonic_ns
        return self._sample(reading, at_ns, frame, self.homing, holds, took_ns)

    def _greet(self, counts_per_turn: tuple[int, ...], frame: RawFrame) -> list[Item]:
        at_ns = frame.monotonic_ns
        faults = self._expected.mismatches(
            self._serial_number, len(counts_per_turn), counts_per_turn
        )
        self.accepted = not faults
        if faults:
            text = f"a foreign arm is connected: {'; '.join(faults)}"
            return [Event("foreign_arm", text, at_ns, "error", {"faults": faults})]
        self.homing = Homing(counts_per_turn, self._before)
        self._unwrapper = self._new_unwrapper(counts_per_turn)
        text = f"MicroScribe {self._serial_number} identified, at {self._instants.baud} baud"
        detail = {"serial_number": self._serial_number, "baud": self._instants.baud}
        return [
            Event("identified", text, at_ns, "info", detail),
            Event("not_homed", f"the arm is not homed: {PUT_IT_TO_REST}", at_ns),
        ]

    def _homed(self, frame: RawFrame) -> list[Item]:
        if self.homing is None or self.homing.homed or self._unwrapper is None:
            return []
        self._unwrapper.restart()
        if self.homing.acknowledged():
            return [Event("homed", "the arm is homed", frame.monotonic_ns, "info")]
        text = f"the homing is not believed, as {self.homing.doubt}"
        return [Event("home_unconfirmed", text, frame.monotonic_ns)]

    def _new_unwrapper(self, counts_per_turn: list[int] | tuple[int, ...]) -> Unwrapper:
        return Unwrapper(counts_per_turn, counts_per_turn, self._max_rate)

    # --- samples -------------------------------------------------------------------------

    def _streamed(self, streamed: Streamed) -> list[Item]:
        """Return the items of a reading that the arm sent by itself."""
        packet, heard, _, lost = streamed
        self.last_sample_ns = heard.monotonic_ns
        stream = self.conversation.stream
        instant = self._instants.streamed(streamed, None if stream is None else stream.pace_ticks)
        if self.homing is None or instant is None:
            self._counted["misplaced"] += 1
            return []
        at_ns, holds = instant
        if lost is None:  # the first packet of the stream
            lost = self._instants.missing(at_ns) if self._seq == self._delivered else 0
        self._seq += 1 + lost
        self._counted["streamed"] += 1
        events = self._whether_it_streams(heard)
        reading = wire.decode_standard(packet)
        return [*events, *self._sample(reading, at_ns, heard, self.homing, holds)]

    def _whether_it_streams(self, frame: RawFrame) -> list[Item]:
        """Return an event once a session when the arm streams, and once when it no longer does."""
        stream, homing = self.conversation.stream, self.homing
        if not self._stream or homing is None or not homing.homed:
            return []
        if stream is not None and self._streaming_state == "":
            pace_ms = stream.pace_ticks * TICK_NS / 1e6
            text = f"the arm sends its readings by itself, one every {pace_ms:.1f} ms"
            self._streaming_state = "streaming"
        elif stream is None and self._hindrance and self._streaming_state != "not_streaming":
            text = f"the arm is asked for each reading, as {self._hindrance}"
            self._streaming_state = "not_streaming"
        else:
            return []
        return [Event(self._streaming_state, text, frame.monotonic_ns, "info")]

    def _sample(
        self,
        reading: wire.StandardReply,
        at_ns: int,
        frame: RawFrame,
        homing: Homing,
        clock_mapped: bool,
        took_ns: int = 0,
    ) -> list[Item]:
        """Make a sample; *took_ns*: from a requested reading's request to its reply."""
        counts = reading.counts[: wire.N_JOINTS]
        self._instants.note_sample(at_ns)
        items: list[Item] = []
        assert self._unwrapper is not None
        was_homed = homing.homed
        if not was_homed:
            refused = homing.watch(counts, reading.buttons, at_ns, reading.ticks, took_ns)
            if refused:
                to_do = LIFT_IT if homing.unconfirmed else PUT_IT_TO_REST
                text = f"the arm stays unhomed, as {refused}: {to_do}"
                items.append(Event("home_refused", text, frame.monotonic_ns))
        if homing.homed:
            homing.follow(counts, at_ns, reading.ticks)
            if not was_homed:
                self._unwrapper.restart()
                text = "the arm is homed: the stylus came back to its rest"
                items.append(Event("homed", text, frame.monotonic_ns, "info"))
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
        sample["clock_mapped"] = clock_mapped
        gap = self._seq - self._delivered - 1
        sample["lost_before"] = self._delivered >= 0 and gap > 0
        self._counted["lost"] += gap if self._delivered >= 0 else 0
        self._delivered = self._seq
        self._counted["samples"] += 1
        return [*items, *self._jumps.events(sample, jumped), sample]

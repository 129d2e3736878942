"""Turns the answers of one cycle into a sample: joints moved to the row's instant, unwrapped."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from armd.drivers.joint_watch import JointWatch
from armd.drivers.poll.lateness import Lateness
from armd.drivers.poll.protocol.family import COUNTS_PER_TURN
from armd.drivers.sample import Event, Item, SampleArray, sample_dtype
from armd.drivers.unwrap import MARGIN_COUNTS, Unwrapper

HALF_TURN = COUNTS_PER_TURN // 2
#: A motion that is not visible in this time covers only a few counts during a stall.
PAST_NS = 20_000_000
TOLD_EVERY_NS = 60_000_000_000  # interval of events about skipped cycles
#: After a pause of this time, and of this many usual spacings, earlier speeds of joints are void.
PAUSE_NS, PAUSE_CYCLES = 100_000_000, 4
#: A joint has leapt if it has moved farther than it can in this time (and in this many usual
#: cycles), whenever it was read last. The motion may be real, or due to another homing offset.
LEAP_NS, LEAP_CYCLES = 5_000_000, 2
#: The usual spacing is the shortest of this many: of two stalls, the second is none (decision 12).
USUAL_OF = 4
#: The limit of a leap uses at most the shortest spacing of this many cycles, or of those before. A
#: host that is busy for seconds makes every cycle slow, and a new offset would look like a motion.
QUICKEST_OF = 500
AGES_NS = 1e18  # longer than any spacing, and a number in JSON


class Cycle(NamedTuple):
    """The content of a cycle; see `ServoSampler.sample`."""

    number: int
    positions: Sequence[int | None]
    at_ns: Sequence[float]
    late_ns: int
    unix_minus_monotonic_ns: int
    unusable: int
    warned: int
    pressed: bool | None


class ServoSampler:
    """Makes one `SampleArray` of each cycle in which a servo answered."""

    def __init__(self, ids: Sequence[int], max_joint_rate_deg_s: float) -> None:
        self.delivered = 0
        self.lost = 0  # cycles without any answer, or whose instant is uncertain
        self.untimed = 0  # number of the latter
        self.jumped = 0  # bits of joints whose counts jumped in the last row
        self.leapt = 0  # bits of joints that must be identified again first
        n = len(ids)
        self._lateness = Lateness()
        #: the first cycle after a pause: the second one shows its speed
        self._pending: Cycle | None = None
        self._heard_ns = 0.0  # instant of the last cycle
        self._spacings_ns: deque[float] = deque(maxlen=USUAL_OF)  # spacings before it
        self._quickest_ns = [AGES_NS, AGES_NS]  # of `QUICKEST_OF` cycles, and of those since
        self._since = 0
        self._counts_per_ns = COUNTS_PER_TURN * max_joint_rate_deg_s / 360e9
        self._dtype = sample_dtype(n)
        self._unwrapper = Unwrapper(
            [COUNTS_PER_TURN] * n, [COUNTS_PER_TURN] * n, max_joint_rate_deg_s
        )
        self._raw = np.zeros((1, n), np.int64)
        self._last: list[tuple[int, float] | None] = [None] * n  # count and instant
        #: all counts at least one `PAST_NS` before the last row, and since
        self._past: list[list[int]] = [[0] * n, [0] * n]
        self._past_ns = 0
        self._first_ns: int | None = None  # the origin of `device_ns`
        self._next_number: int | None = None
        self._told_ns: int | None = None  # when an untimed cycle was last reported
        self._buttons = 0
        names = [f"joint {k} (servo {servo})" for k, servo in enumerate(ids, 1)]
        self._silence_watch = JointWatch(
            "joint_invalid", "no answer, or two that differ", "it answers", names
        )
        self._jump_watch = JointWatch("count_jump", "its count jumped", "it jumps no more", names)

    def sample(
        self,
        number: int,
        positions: Sequence[int | None],
        at_ns: Sequence[float],
        late_ns: int,
        unix_minus_monotonic_ns: int,
        unusable: int,
        warned: int,
        pressed: bool | None,
    ) -> list[Item]:
        """Return the sample of cycle *number*, after the events of its joints.

        After a pause, the second cycle returns the samples of both.

        *positions* (N,) are raw counts at the instants *at_ns* (N,), the first of which is the
        row's. *late_ns*: lateness of the answers. If it makes the instants uncertain and a joint
        moves, the cycle counts as lost, because the positions have no known instant. *unusable*:
        bits of joints that answer but are not valid; *warned*: bits of joints that warn; *pressed*:
        the button, None without an answer.
        """
        cycle = Cycle(
            number, positions, at_ns, late_ns, unix_minus_monotonic_ns, unusable, warned, pressed
        )
        self._lateness.add(late_ns)
        spacing_ns, self._heard_ns = at_ns[0] - self._heard_ns, at_ns[0]
        self._note_spacing(spacing_ns)
        if self._pending is not None:
            first, self._pending = self._pending, None
            self._spacings_ns.append(spacing_ns)
            raw = [
                None if position is None else position - HALF_TURN for position in first.positions
            ]
            leapt = self._leaps(raw, first.at_ns, spacing_ns)  # during the pause
            self._begin(first, cycle)
            return [*self._row(first, 0.0, leapt), *self._row(cycle, spacing_ns, leapt)]
        usual_ns = min(self._spacings_ns, default=0.0)
        if spacing_ns > max(PAUSE_NS, PAUSE_CYCLES * usual_ns):
            self._pending = cycle
            self._spacings_ns.clear()
            return []
        self._spacings_ns.append(spacing_ns)
        return self._row(cycle, usual_ns)

    def pause(self) -> None:
        """Forget the last cycle, because the line is closed."""
        self._pending = None
        self._last = [None] * len(self._last)

    def _begin(self, first: Cycle, cycle: Cycle) -> None:
        """Set each joint's reading before *first*, extrapolated from *cycle* back over *first*."""
        for k, (position, later) in enumerate(zip(first.positions, cycle.positions, strict=True)):
            if position is None or later is None:
                continue
            apart_ns = cycle.at_ns[k] - first.at_ns[k]
            step = (later - position + HALF_TURN) % COUNTS_PER_TURN - HALF_TURN
            if abs(step) > MARGIN_COUNTS + self._counts_per_ns * apart_ns:
                step = 0  # a jump, not a motion
            self._last[k] = position - HALF_TURN - step, first.at_ns[k] - apart_ns
        self._past_ns = 0
        self._note_past(round(first.at_ns[0]))

    def _row(self, cycle: Cycle, usual_ns: float, leapt: int = 0) -> list[Item]:
        number, positions, at_ns, late_ns, unix_minus_monotonic_ns, unusable, warned, pressed = (
            cycle
        )
        row_ns, doubt_ns = round(at_ns[0]), self._lateness.doubt_ns(late_ns)
        self.jumped, self.leapt = 0, leapt
        if doubt_ns and self._moves(positions, row_ns + doubt_ns):
            self.untimed += 1
            return self._tell_untimed(row_ns, doubt_ns)
        if self._first_ns is None:
            self._first_ns = row_ns
        silent = 0
        for k, position in enumerate(positions):
            if position is None:
                silent |= 1 << k
            else:
                self._raw[0, k] = position - HALF_TURN
        counts, jumped = self._unwrapper(
            self._raw, np.array([row_ns // 1000]), np.array([silent], np.uint16)
        )
        self.jumped = jumps = int(jumped[0])
        if usual_ns:
            leapt |= self._leaps(counts[0].tolist(), at_ns, usual_ns)
        self.leapt = leapt & ~(silent | jumps)
        if pressed is not None:
            self._buttons = int(pressed)
        out: SampleArray = np.zeros(1, self._dtype)
        out["count"][0] = self._moved(counts[0].tolist(), at_ns, row_ns, silent | jumps)
        self._note_past(row_ns)
        out["seq"] = number
        out["device_ns"] = row_ns - self._first_ns
        out["monotonic_ns"] = row_ns
        out["stamp_ns"] = row_ns + unix_minus_monotonic_ns
        out["joint_invalid"] = silent | jumps | self.leapt | unusable
        out["joint_warning"] = warned
        out["buttons"] = self._buttons
        out["clock_mapped"] = True
        if self._next_number is not None:
            out["lost_before"] = number != self._next_number
            self.lost += number - self._next_number
        self._next_number = number + 1
        self.delivered += 1
        return [
            *self._silence_watch.events(out, np.array([silent], np.uint16)),
            *self._jump_watch.events(out, jumped),
            out,
        ]

    def _tell_untimed(self, now_ns: int, doubt_ns: float) -> list[Item]:
        if self._told_ns is not None and now_ns - self._told_ns < TOLD_EVERY_NS:
            return []
        self._told_ns = now_ns
        text = (
            f"a cycle is left out, its instant is in doubt by {doubt_ns * 1e-6:.1f} ms while the"
            " arm moves: this computer is too busy, or the adapter holds bytes back (armd doctor)"
        )
        return [Event("untimed", text, now_ns, "warning", {"doubt_ms": round(doubt_ns * 1e-6, 1)})]

    def _moves(self, positions: Sequence[int | None], until_ns: float) -> bool:
        """Return whether a joint has moved since its last reading, or shortly before that.

        Flickering by a count is no motion. Nor is a step that no joint can have made by *until_ns*:
        its joint is invalid in this row anyway.
        """
        for k, (position, last) in enumerate(zip(positions, self._last, strict=True)):
            if position is None or last is None:
                continue
            step = (position - last[0]) % COUNTS_PER_TURN - HALF_TURN
            moved = max(abs(step), abs(last[0] - self._past[0][k]))
            fastest = MARGIN_COUNTS + self._counts_per_ns * (until_ns - last[1])
            if moved > 1 and abs(step) <= fastest:
                return True
        return False

    def _leaps(self, counts: Sequence[int | None], at_ns: Sequence[float], usual_ns: float) -> int:
        """Return bits of answering joints that moved so far that only a gap in the cycles allows
        it.
        """
        most_ns, bits = max(LEAP_NS, LEAP_CYCLES * min(usual_ns, *self._quickest_ns)), 0
        for k, (count, last) in enumerate(zip(counts, self._last, strict=True)):
            if count is not None and last is not None and at_ns[k] - last[1] > most_ns:
                step = (count - last[0] + HALF_TURN) % COUNTS_PER_TURN - HALF_TURN
                bits |= (abs(step) > MARGIN_COUNTS + self._counts_per_ns * most_ns) << k
        return bits

    def _note_spacing(self, spacing_ns: float) -> None:
        if self._since == QUICKEST_OF:
            self._quickest_ns, self._since = [self._quickest_ns[1], AGES_NS], 0
        self._quickest_ns[1] = min(self._quickest_ns[1], spacing_ns)
        self._since += 1

    def _note_past(self, row_ns: int) -> None:
        if row_ns - self._past_ns >= PAST_NS:
            counts = [0 if last is None else last[0] for last in self._last]
            self._past = [self._past[1] if self._past_ns else counts, counts]
            self._past_ns = row_ns

    def _moved(
        self, counts: list[int], at_ns: Sequence[float], row_ns: int, doubtful: int
    ) -> list[float]:
        """Move *counts* to the row's instant, on the line from each joint's last reading."""
        moved: list[float] = []
        for k, count in enumerate(counts):
            last = self._last[k]
            count_then = float(count)
            if not doubtful >> k & 1:
                if last is not None and at_ns[k] > last[1]:
                    step = (count - last[0] + HALF_TURN) % COUNTS_PER_TURN - HALF_TURN
                    count_then -= step * (at_ns[k] - row_ns) / (at_ns[k] - last[1])
                self._last[k] = count, at_ns[k]
            moved.append(count_then)
        return moved

    def state(self) -> dict[str, Any]:
        """Return the state for `restore` in a replay, as JSON."""
        memory = self._unwrapper.memory
        return {
            "first_ns": self._first_ns,
            "next_number": self._next_number,
            "buttons": self._buttons,
            "last": self._last,
            "told_ns": self._told_ns,
            "past": [self._past, self._past_ns],
            "late": list(self._lateness.seen_ns),
            "held": self._pending,
            "heard": [self._heard_ns, *self._spacings_ns],
            "quickest": [*self._quickest_ns, self._since],
            "unwrap": [memory[name].tolist() for name in memory.dtype.names or ()],
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from *state*."""
        self._first_ns, self._next_number = state["first_ns"], state["next_number"]
        self._buttons, self._told_ns = state["buttons"], state["told_ns"]
        self._last = [None if last is None else (last[0], last[1]) for last in state["last"]]
        self._past, self._past_ns = state["past"]
        self._lateness.seen_ns.extend(state["late"])
        self._pending = None if state["held"] is None else Cycle(*state["held"])
        self._heard_ns, *spacings_ns = state["heard"]
        self._spacings_ns.extend(spacings_ns)
        if "quickest" in state:  # not in recordings before version 0.3
            *self._quickest_ns, self._since = state["quickest"]
        memory = self._unwrapper.memory
        for name, values in zip(memory.dtype.names or (), state["unwrap"], strict=True):
            memory[name] = values

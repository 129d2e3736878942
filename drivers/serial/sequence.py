"""Extends device sequence numbers so that they never fall, and separates repeats from reboots.

`seq` is ``epoch << 32 | device seq``. The epoch grows when the 32-bit counter wraps and when the
arm reboots. A reboot shows by a new boot id in HELLO or, if that is lost, by a device clock that
runs backwards. The time of a late or repeated packet runs backwards too. But a reboot continues
from there, and its clock cannot have run for longer than the wait.

A doubt remains if samples of this boot were accepted before at these very times. Then the arm's
clock is asked (PING). If it has kept running, the arm has not booted, and the packets are repeats.
If it has not, the arm has booted, even with the same boot id.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armd.compiled.jit import jit

Rows = npt.NDArray[np.void]  # (m,) of wire.make_row_layout

WRAP = 1 << 32
LATENESS_NS = 100_000_000  # the largest delay of bytes on the line
CERTAIN = 32  # this many successive packets from the past mean a reboot, at any clock
UNANSWERED_NS = 1_000_000_000  # an arm that does not answer PING for this long has booted
BEHIND_NS = 5_000_000  # a clock that is this far behind has not kept running
DRIFT = 500e-6  # crystals differ by less
SUSPECTS_MOST = 1 << 14
GAP_US = 1_000_000  # a longer gap of the device's clock counts as not seen
STRETCHES_MOST = 64  # number of intervals seen; older ones are forgotten

#: The state after the packets accepted so far.
_MEMORY = np.dtype(
    [
        ("seq", "i8"),  # of the last packet; −1: none since the start, or since the boot
        ("t_us", "i8"),
        ("since_us", "i8"),  # beginning of the interval up to `t_us` without a gap
        ("arrival_ns", "i8"),
        ("epoch", "i8"),
        ("lost", "i8"),
    ]
)


class Run(NamedTuple):
    """Consecutive accepted rows with their extended numbers."""

    rows: Rows
    epoch: int
    arrival_ns: int
    rebooted: bool  # the arm rebooted just before this run


class SequenceExtender:
    """Accepts each new sample once, in order. `lost` and `repeated` count the others."""

    def __init__(self) -> None:
        self.repeated = 0
        self._cleared: list[tuple[Rows, int]] = []
        self.memory = np.zeros(1, _MEMORY)  # the state that `is_continuous` reads and updates
        self._last = self.memory[0]
        self._last["seq"] = self._last["t_us"] = -1
        self._suspects: deque[tuple[Rows, int]] = deque()
        self._stretches_us: deque[tuple[int, int]] = deque(
            maxlen=STRETCHES_MOST
        )  # intervals of this boot, µs
        self.wants_clock = False  # only the arm's clock can show whether it has rebooted

    @property
    def epoch(self) -> int:
        return int(self._last["epoch"])

    @property
    def lost(self) -> int:
        return int(self._last["lost"])

    @property
    def in_doubt(self) -> bool:
        """Whether packets are held back until more come: then only `push` can decide."""
        return bool(self._suspects)

    def start_in(self, epoch: int) -> None:
        """Begin in the middle of a stream, as a recording does."""
        self._last["epoch"] = epoch

    def new_boot(self) -> None:
        """Record that the arm reported a boot: its counter and clock start again.

        Doubtful rows that can be of the new boot wait in `take_cleared`.
        """
        if self._last["seq"] >= 0:
            self._last["epoch"] += 1
            self._last["seq"] = self._last["t_us"] = -1
        self._stretches_us.clear()
        self._cleared = [suspect for suspect in self._suspects if self._possible(*suspect)]
        self.repeated += len(self._suspects) - len(self._cleared)
        self._suspects.clear()
        self.wants_clock = False

    def clock_read(self, t_us: int, after_ns: int) -> list[Run]:
        """Decide on the doubtful rows; return the runs of a new boot.

        The arm's clock read *t_us*, later than *after_ns* of the host's (monotonic). The rows are
        repeats, or those of a new boot.
        """
        if not self.wants_clock:
            return []
        since_ns = after_ns - int(self._last["arrival_ns"])  # a sample is older than its arrival
        ran_on_ns = 1000 * int(self._last["t_us"]) + since_ns * (1 - DRIFT)
        if 1000 * t_us >= ran_on_ns - BEHIND_NS:
            self._drop_suspects()
            return []
        return self._believe_suspects()

    def take_cleared(self) -> list[tuple[Rows, int]]:
        """Return the rows that belong to the new boot, with their arrivals; `push` takes them."""
        cleared, self._cleared = self._cleared, []
        return cleared

    def push(self, rows: Rows, arrival_ns: int) -> list[Run]:
        """Take *rows* in the order of the wire, arrived at *arrival_ns* (host, monotonic)."""
        runs: list[Run] = []
        while len(rows):
            if not self._suspects and is_continuous(rows, arrival_ns, self.memory):
                return [*runs, Run(rows, self.epoch, arrival_ns, False)]
            runs += self._judge(rows[:1], arrival_ns)
            rows = rows[1:]
        return runs

    def _judge(self, row: Rows, arrival_ns: int) -> list[Run]:
        seq, t_us = int(row["seq"][0]), int(row["t_us"][0])
        last_seq, last_us = int(self._last["seq"]), int(self._last["t_us"])
        if last_seq < 0:
            return [self._accept(row, arrival_ns)]
        if t_us >= last_us and seq == last_seq:
            self.repeated += 1
            return []
        if t_us > last_us or (t_us == last_us and seq > last_seq):
            self._drop_suspects()
            if seq < last_seq:
                self._last["epoch"] += 1
            return [self._accept(row, arrival_ns)]
        if 0 < (seq - last_seq) % WRAP < WRAP // 2:  # the counter continued, the clock did not
            self._drop_suspects()
            self._last["epoch"] += 1
            return [self._accept(row, arrival_ns, rebooted=True)]
        return self._suspect(row, arrival_ns)

    def _suspect(self, row: Rows, arrival_ns: int) -> list[Run]:
        """Hold a packet with a past time: late, repeated, or one of the first of another boot."""
        t_us = int(row["t_us"][0])
        if self._suspects and t_us <= self._suspects[-1][0]["t_us"][0]:
            if self.wants_clock and t_us < self._suspects[0][0]["t_us"][0]:
                self._drop_suspects()  # repeats, then a boot: only the boot counts
            else:
                self.repeated += 1
                return []
        self._suspects.append((row.copy(), arrival_ns))
        if len(self._suspects) > SUSPECTS_MOST:
            self._suspects.popleft()
            self.repeated += 1
        self.wants_clock = self.wants_clock or self._was_seen(t_us)
        first, first_arrival_ns = self._suspects[0]
        needed = 2 if self._possible(first, first_arrival_ns) else CERTAIN
        in_doubt = self.wants_clock and arrival_ns - first_arrival_ns < UNANSWERED_NS
        if len(self._suspects) < needed or in_doubt:
            return []
        return self._believe_suspects()

    def _believe_suspects(self) -> list[Run]:
        """Accept the held packets as the first of another boot."""
        suspects, self._suspects = self._suspects, deque()
        self._last["epoch"] += 1
        self._stretches_us.clear()
        self.wants_clock = False
        runs = [self._accept(suspects[0][0], suspects[0][1], rebooted=True)]
        for later, arrived_ns in list(suspects)[1:]:
            runs += self.push(later, arrived_ns)
        return runs

    def _possible(self, row: Rows, arrival_ns: int) -> bool:
        """Return whether a boot since the last accepted packet can have sent *row* by then."""
        waited_ns = arrival_ns - int(self._last["arrival_ns"]) + LATENESS_NS
        return int(row["t_us"][0]) * 1000 <= waited_ns

    def _was_seen(self, t_us: int) -> bool:
        """Return whether samples of this boot were accepted around this device time."""
        now = (int(self._last["since_us"]), int(self._last["t_us"]))
        return any(first <= t_us <= last for first, last in (*self._stretches_us, now))

    def _drop_suspects(self) -> None:
        self.repeated += len(self._suspects)
        self._suspects.clear()
        self.wants_clock = False

    def _accept(self, row: Rows, arrival_ns: int, rebooted: bool = False) -> Run:
        seq, last_seq = int(row["seq"][0]), int(self._last["seq"])
        if last_seq >= 0 and not rebooted:
            gap = (seq - last_seq) % WRAP - 1
            self._last["lost"] += gap if seq > last_seq or gap < WRAP // 2 else 0
        t_us, last_us = int(row["t_us"][0]), int(self._last["t_us"])
        if last_us < 0 or rebooted:
            self._last["since_us"] = t_us
        elif t_us - last_us > GAP_US:
            self._stretches_us.append((int(self._last["since_us"]), last_us))
            self._last["since_us"] = t_us
        self._last["seq"], self._last["t_us"] = seq, t_us
        self._last["arrival_ns"] = arrival_ns
        return Run(row, self.epoch, arrival_ns, rebooted)


@jit
def is_continuous(rows: Any, arrival_ns: int, memory: Any) -> bool:
    """Return whether *rows* (m,) directly follow the last ones: then accept all, else none.

    That is the usual case. *memory* belongs to a `SequenceExtender`.
    """
    last = memory[0]
    seq, t_us, since_us = last.seq, last.t_us, last.since_us
    for row in rows:
        if np.int64(row.seq) <= seq or np.int64(row.t_us) <= t_us:
            return False
        if t_us < 0:
            since_us = np.int64(row.t_us)
        elif np.int64(row.t_us) - t_us > GAP_US:
            return False
        seq, t_us = np.int64(row.seq), np.int64(row.t_us)
    before = last.seq if last.seq >= 0 else np.int64(rows[0].seq) - 1
    last.lost += seq - before - len(rows)
    last.seq, last.t_us, last.since_us, last.arrival_ns = seq, t_us, since_us, arrival_ns
    return True

"""Device sequence numbers → numbers that never fall; repeats told from reboots.

`seq` is ``epoch << 32 | device seq``. The epoch grows when the 32-bit counter wraps and when
the arm reboots. A reboot announces itself by a new boot id in HELLO; should that be lost, by the
device clock running backwards. A packet that comes twice, or late, runs backwards too: what
tells them apart is that a reboot goes on from there, and that its clock cannot have run for
longer than we have been waiting.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armd.jit import jit

Rows = npt.NDArray[np.void]  # (m,) of serial_wire.row_layout

WRAP = 1 << 32
LATENESS_NS = 100_000_000  # by how much bytes may arrive late
CERTAIN = 32  # so many packets running on in the past are a reboot, whatever the clock says

#: What is remembered of the packets accepted so far.
_MEMORY = np.dtype(
    [
        ("seq", "i8"),  # of the last packet; −1: none since the start, or since the boot
        ("t_us", "i8"),
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
        self.memory = np.zeros(1, _MEMORY)  # what `goes_on` takes and keeps
        self._kept = self.memory[0]
        self._kept["seq"] = self._kept["t_us"] = -1
        self._suspects: list[tuple[Rows, int]] = []

    @property
    def epoch(self) -> int:
        return int(self._kept["epoch"])

    @property
    def lost(self) -> int:
        return int(self._kept["lost"])

    @property
    def in_doubt(self) -> bool:
        """Whether packets are held back until more come: then only `push` can tell."""
        return bool(self._suspects)

    def start_in(self, epoch: int) -> None:
        """Begin in the middle of a stream, as a recording does."""
        self._kept["epoch"] = epoch

    def new_boot(self) -> None:
        """The arm says that it has booted: its counter and clock start afresh."""
        if self._kept["seq"] >= 0:
            self._kept["epoch"] += 1
            self._kept["seq"] = self._kept["t_us"] = -1
        self._suspects.clear()

    def push(self, rows: Rows, arrival_ns: int) -> list[Run]:
        """*rows* in the order of the wire, arrived at *arrival_ns* (host, monotonic)."""
        runs: list[Run] = []
        while len(rows):
            if not self._suspects and goes_on(rows, arrival_ns, self.memory):
                return [*runs, Run(rows, self.epoch, arrival_ns, False)]
            runs += self._judge(rows[:1], arrival_ns)
            rows = rows[1:]
        return runs

    def _judge(self, row: Rows, arrival_ns: int) -> list[Run]:
        seq, t_us = int(row["seq"][0]), int(row["t_us"][0])
        last_seq, last_us = int(self._kept["seq"]), int(self._kept["t_us"])
        if last_seq < 0:
            return [self._accept(row, arrival_ns)]
        if t_us >= last_us and seq == last_seq:
            self.repeated += 1
            return []
        if t_us > last_us or (t_us == last_us and seq > last_seq):
            self._drop_suspects()
            if seq < last_seq:
                self._kept["epoch"] += 1
            return [self._accept(row, arrival_ns)]
        if 0 < (seq - last_seq) % WRAP < WRAP // 2:  # the counter went on, the clock did not
            self._drop_suspects()
            self._kept["epoch"] += 1
            return [self._accept(row, arrival_ns, rebooted=True)]
        return self._suspect(row, arrival_ns)

    def _suspect(self, row: Rows, arrival_ns: int) -> list[Run]:
        """A packet out of the past: late or repeated, or the first ones of another boot?"""
        if self._suspects and row["t_us"][0] <= self._suspects[-1][0]["t_us"][0]:
            self.repeated += 1
            return []
        self._suspects.append((row.copy(), arrival_ns))
        first, first_arrival_ns = self._suspects[0]
        waited_ns = first_arrival_ns - int(self._kept["arrival_ns"]) + LATENESS_NS
        possible = int(first["t_us"][0]) * 1000 <= waited_ns
        if len(self._suspects) < (2 if possible else CERTAIN):
            return []
        found, self._suspects = self._suspects, []
        self._kept["epoch"] += 1
        runs = [self._accept(found[0][0], found[0][1], rebooted=True)]
        for later, arrived_ns in found[1:]:
            runs += self.push(later, arrived_ns)
        return runs

    def _drop_suspects(self) -> None:
        self.repeated += len(self._suspects)
        self._suspects.clear()

    def _accept(self, row: Rows, arrival_ns: int, rebooted: bool = False) -> Run:
        seq, last_seq = int(row["seq"][0]), int(self._kept["seq"])
        if last_seq >= 0 and not rebooted:
            gap = (seq - last_seq) % WRAP - 1
            self._kept["lost"] += gap if seq > last_seq or gap < WRAP // 2 else 0
        self._kept["seq"], self._kept["t_us"] = seq, int(row["t_us"][0])
        self._kept["arrival_ns"] = arrival_ns
        return Run(row, self.epoch, arrival_ns, rebooted)


@jit
def goes_on(rows: Any, arrival_ns: int, memory: Any) -> bool:
    """Whether *rows* (m,) plainly follow what went before, the usual case: then all are accepted,
    else none. *memory* is a `SequenceExtender`'s."""
    kept = memory[0]
    seq, t_us = kept.seq, kept.t_us
    for row in rows:
        if np.int64(row.seq) <= seq or np.int64(row.t_us) <= t_us:
            return False
        seq, t_us = np.int64(row.seq), np.int64(row.t_us)
    before = kept.seq if kept.seq >= 0 else np.int64(rows[0].seq) - 1
    kept.lost += seq - before - len(rows)
    kept.seq, kept.t_us, kept.arrival_ns = seq, t_us, arrival_ns
    return True

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
NOTHING = (-1, -1, 0)  # in the place of a last packet
CERTAIN = 32  # so many packets running on in the past are a reboot, whatever the clock says


class Run(NamedTuple):
    """Consecutive accepted rows with their extended numbers."""

    rows: Rows
    epoch: int
    arrival_ns: int
    rebooted: bool  # the arm rebooted just before this run


class SequenceExtender:
    """Accepts each new sample once, in order. `lost` and `repeated` count the others."""

    def __init__(self) -> None:
        self.lost = 0
        self.repeated = 0
        self.epoch = 0
        self._last: tuple[int, int, int] | None = None  # seq, t_us, arrival_ns
        self._suspects: list[tuple[Rows, int]] = []

    def start_in(self, epoch: int) -> None:
        """Begin in the middle of a stream, as a recording does."""
        self.epoch = epoch

    def new_boot(self) -> None:
        """The arm says that it has booted: its counter and clock start afresh."""
        if self._last is not None:
            self.epoch += 1
            self._last = None
        self._suspects.clear()

    def push(self, rows: Rows, arrival_ns: int) -> list[Run]:
        """*rows* in the order of the wire, arrived at *arrival_ns* (host, monotonic)."""
        runs: list[Run] = []
        while len(rows):
            if not self._suspects and (run := self._go_on(rows, arrival_ns)) is not None:
                return [*runs, run]
            runs += self._judge(rows[:1], arrival_ns)
            rows = rows[1:]
        return runs

    def _go_on(self, rows: Rows, arrival_ns: int) -> Run | None:
        """All of *rows* at once where they plainly follow what went before: the usual case."""
        seq, t_us, _ = self._last or NOTHING
        first, last, last_us = _ends(rows, seq, t_us)
        if first < 0:
            return None
        self.lost += last - len(rows) - (seq if self._last else first - 1)
        self._last = (last, last_us, arrival_ns)
        return Run(rows, self.epoch, arrival_ns, False)

    def _judge(self, row: Rows, arrival_ns: int) -> list[Run]:
        if self._last is None:
            return [self._accept(row, arrival_ns)]
        seq, t_us = int(row["seq"][0]), int(row["t_us"][0])
        last_seq, last_us, _ = self._last
        if t_us >= last_us and seq == last_seq:
            self.repeated += 1
            return []
        if t_us > last_us or (t_us == last_us and seq > last_seq):
            self._drop_suspects()
            if seq < last_seq:
                self.epoch += 1
            return [self._accept(row, arrival_ns)]
        if 0 < (seq - last_seq) % WRAP < WRAP // 2:  # the counter went on, the clock did not
            self._drop_suspects()
            self.epoch += 1
            return [self._accept(row, arrival_ns, rebooted=True)]
        return self._suspect(row, arrival_ns)

    def _suspect(self, row: Rows, arrival_ns: int) -> list[Run]:
        """A packet out of the past: late or repeated, or the first ones of another boot?"""
        if self._suspects and row["t_us"][0] <= self._suspects[-1][0]["t_us"][0]:
            self.repeated += 1
            return []
        self._suspects.append((row.copy(), arrival_ns))
        assert self._last is not None
        first, first_arrival_ns = self._suspects[0]
        waited_ns = first_arrival_ns - self._last[2] + LATENESS_NS
        possible = int(first["t_us"][0]) * 1000 <= waited_ns
        if len(self._suspects) < (2 if possible else CERTAIN):
            return []
        found, self._suspects = self._suspects, []
        self.epoch += 1
        runs = [self._accept(found[0][0], found[0][1], rebooted=True)]
        for later, arrived_ns in found[1:]:
            runs += self.push(later, arrived_ns)
        return runs

    def _drop_suspects(self) -> None:
        self.repeated += len(self._suspects)
        self._suspects.clear()

    def _accept(self, row: Rows, arrival_ns: int, rebooted: bool = False) -> Run:
        seq = int(row["seq"][0])
        if self._last is not None and not rebooted:
            gap = (seq - self._last[0]) % WRAP - 1
            self.lost += gap if seq > self._last[0] or gap < WRAP // 2 else 0
        self._last = (seq, int(row["t_us"][0]), arrival_ns)
        return Run(row, self.epoch, arrival_ns, rebooted)


@jit
def _ends(rows: Any, seq: Any, t_us: Any) -> Any:
    """First and last number of *rows* and their last time, if both rise from row to row and from
    *seq* and *t_us* on; else −1 thrice."""
    first = np.int64(rows[0].seq)
    for row in rows:
        if np.int64(row.seq) <= seq or np.int64(row.t_us) <= t_us:
            return -1, -1, -1
        seq, t_us = np.int64(row.seq), np.int64(row.t_us)
    return first, seq, t_us

"""Turns accepted packets into samples: unwrapped counts, host time, invalid joints, lost rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from armd.compiled.jit import jit, select_compiled
from armd.drivers.joint_watch import JointWatch
from armd.drivers.sample import Item, SampleArray, sample_dtype
from armd.drivers.serial.clock import ClockMapping, can_promise, compute_host_ns
from armd.drivers.serial.sequence import Rows, Run, SequenceExtender, is_continuous
from armd.drivers.serial.unpacking import SampleBytes, unpack_samples
from armd.drivers.serial.wire import encode_sample, make_row_layout
from armd.drivers.unwrap import Unwrapper, unwrap

#: Number of samples in one array: numpy needs as long to make an array as to fill it.
ROOM = 256
NONE = -1  # no number yet; rows that do not follow


class SampleAssembler:
    """Makes `SampleArray`s of one arm; `delivered` counts their rows."""

    def __init__(self, n_joints: int, clock: ClockMapping, max_joint_rate_deg_s: float) -> None:
        self.delivered = 0
        self._dtype = sample_dtype(n_joints)
        self._clock = clock
        self._max_rate = max_joint_rate_deg_s
        self._unwrapper: Unwrapper | None = None
        self._next_seq = np.full(1, NONE)  # the number after the last one
        self._status_watch = JointWatch(
            "joint_invalid", "the arm calls it invalid", "the arm calls it valid"
        )
        self._jump_watch = JointWatch("count_jump", "its count jumped", "it jumps no more")
        self._out = np.empty(0, self._dtype)
        self._used = 0
        self._jumped = np.zeros(0, np.uint16)
        self._bytes = SampleBytes(n_joints)
        #: `_unpack_and_go_on`, compiled for the types of its arguments, which never change.
        self._go_on: Callable[..., int] | None = None

    def set_bits(self, bits: Sequence[int]) -> None:
        """Set the joints' ranges before the first run: counts of joint k wrap at 2^bits[k-1]."""
        if self._unwrapper is None:
            ranges = [1 << b for b in bits]
            self._unwrapper = Unwrapper(ranges, ranges, self._max_rate)
            self._go_on = None

    def new_boot(self) -> None:
        """Forget the encoders' turns, because the arm has booted."""
        if self._unwrapper is not None:
            self._unwrapper.restart()

    def go_on(
        self, data: bytes, sequence: SequenceExtender, arrival_ns: int, unix_minus_monotonic_ns: int
    ) -> list[Item] | None:
        """Unpack and assemble the usual case in one compiled call.

        *data* must be whole packets, all good SAMPLEs that directly follow the last ones. Otherwise
        it does nothing and returns None.
        """
        unwrapper, sample_bytes = self._unwrapper, self._bytes
        if unwrapper is None or sequence.in_doubt:
            return None
        n = sample_bytes.put(data)
        if n == 0:
            return None
        out = self._room(n)
        arguments = (
            n, sample_bytes.packets, sample_bytes.row_bytes, sample_bytes.rows, sequence.memory,
            self._clock.line, arrival_ns, unix_minus_monotonic_ns, self._next_seq,
            unwrapper.memory, out, self._jumped,
        )  # fmt: skip
        if self._go_on is None:
            self._go_on = select_compiled(_unpack_and_go_on, *arguments)
        trouble = self._go_on(*arguments)
        return None if trouble == NONE else self._with_events(sample_bytes.rows, out, trouble)

    def assemble(self, run: Run, unix_minus_monotonic_ns: int) -> list[Item]:
        """Return one array of samples, after the events of its joints."""
        assert self._unwrapper is not None
        out = self._room(len(run.rows))
        trouble = _assemble(
            run.rows, run.epoch, self._clock.line, run.arrival_ns, unix_minus_monotonic_ns,
            self._next_seq, self._unwrapper.memory, out, self._jumped,
        )  # fmt: skip
        return self._with_events(run.rows, out, trouble)

    def _room(self, n: int) -> SampleArray:
        """Return an unused array (n,)."""
        end = self._used + n
        if end > len(self._out):
            self._out = np.empty(max(n, ROOM), self._dtype)
            self._jumped = np.zeros(len(self._out), np.uint16)
            self._used, end = 0, n
        out, self._used = self._out[self._used : end], end
        return out

    def _with_events(self, rows: Rows, out: SampleArray, trouble: int) -> list[Item]:
        self.delivered += len(out)
        if not trouble and not self._status_watch.active and not self._jump_watch.active:
            return [out]
        status = rows["joint_status"][: len(out)].astype(np.uint16)
        return [
            *self._status_watch.events(out, status),
            *self._jump_watch.events(out, self._jumped[: len(out)]),
            out,
        ]

    def warm_up(self) -> None:
        """Compile the functions, or load them from the cache, before the first sample arrives."""
        n_joints = self._dtype["count"].shape[0]
        trial = SampleAssembler(n_joints, self._clock, self._max_rate)
        trial.set_bits([20] * n_joints)
        sequence, rows = SequenceExtender(), np.zeros(1, make_row_layout(n_joints))
        trial.go_on(encode_sample(0, 0, [0] * n_joints), sequence, 0, 0)
        for run in sequence.push(rows, 0):
            trial.assemble(run, 0)
        trial.assemble(Run(rows, 0, 0, False), 0)
        self._clock.to_host(0)


@jit
def _unpack_and_go_on(
    n: int, packets: Any, row_bytes: Any, rows: Any, sequence: Any, line: Any, arrival_ns: int,
    unix_minus_monotonic_ns: int, next_seq: Any, memory: Any, out: Any, jumped: Any,
) -> int:  # fmt: skip
    if not unpack_samples(n, packets, row_bytes):
        return NONE
    rows = rows[:n]
    if not is_continuous(rows, arrival_ns, sequence):
        return NONE
    return _assemble(
        rows, sequence[0].epoch, line, arrival_ns, unix_minus_monotonic_ns, next_seq, memory, out,
        jumped,
    )  # fmt: skip


@jit
def _assemble(
    rows: Any, epoch: int, line: Any, arrival_ns: int, unix_minus_monotonic_ns: int,
    next_seq: Any, memory: Any, out: Any, jumped: Any,
) -> int:  # fmt: skip
    """Fill *out* and *jumped* (bits of joints); return the bits of joints faulty in any row."""
    last_ns = np.int64(rows[len(rows) - 1].t_us) * 1000
    trouble = 0
    for i in range(len(rows)):
        row, sample = rows[i], out[i]
        seq, t_us = epoch << 32 | np.int64(row.seq), np.int64(row.t_us)
        device_ns = t_us * 1000
        monotonic_ns = compute_host_ns(device_ns, line)
        mapped = can_promise(device_ns, monotonic_ns, arrival_ns, line)
        if not mapped:
            monotonic_ns = arrival_ns - (last_ns - device_ns)
        status = np.uint16(row.joint_status)
        jumps = unwrap(row.count, t_us, status, memory, sample.count)
        sample.seq = seq
        sample.device_ns = device_ns
        sample.stamp_ns = monotonic_ns + unix_minus_monotonic_ns
        sample.monotonic_ns = monotonic_ns
        sample.joint_invalid = status | jumps
        sample.joint_warning = 0
        sample.buttons = row.buttons
        sample.clock_mapped = mapped
        sample.lost_before = next_seq[0] != NONE and seq != next_seq[0]
        next_seq[0] = seq + 1
        jumped[i] = jumps
        trouble |= status | jumps
    return trouble

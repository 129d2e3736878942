"""Accepted packets → samples: unwrapped counts, host time, what is invalid, what was lost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armd.drivers.clock import DeviceClock, host_ns
from armd.drivers.joint_watch import JointWatch
from armd.drivers.sample import Item, sample_dtype
from armd.drivers.sequence import Run
from armd.drivers.serial_wire import row_layout
from armd.drivers.unwrap import Unwrapper, unwrap
from armd.jit import jit


class SampleAssembler:
    """Makes `SampleArray`s of one arm; `delivered` counts their rows."""

    def __init__(self, n_joints: int, clock: DeviceClock, max_joint_rate_deg_s: float) -> None:
        self.delivered = 0
        self._dtype = sample_dtype(n_joints)
        self._clock = clock
        self._max_rate = max_joint_rate_deg_s
        self._unwrapper: Unwrapper | None = None
        self._next_seq = np.zeros(1, np.uint64)
        self._status_watch = JointWatch("joint_invalid", "the arm calls it invalid")
        self._jump_watch = JointWatch("count_jump", "its count jumped")
        self._jumped = np.zeros(1, np.uint16)

    def set_bits(self, bits: Sequence[int]) -> None:
        """Counts of joint k wrap at 2^bits[k-1]; to be told before the first run."""
        if self._unwrapper is None:
            ranges = [1 << b for b in bits]
            self._unwrapper = Unwrapper(ranges, ranges, self._max_rate)

    def new_boot(self) -> None:
        """The encoders' turns are unknown again."""
        if self._unwrapper is not None:
            self._unwrapper.restart()

    def assemble(self, run: Run, unix_minus_monotonic_ns: int) -> list[Item]:
        """One array, after the events its joints give rise to."""
        assert self._unwrapper is not None
        n = len(run.rows)
        if n > len(self._jumped):
            self._jumped = np.zeros(2 * n, np.uint16)
        jumped = self._jumped[:n]
        out = np.empty(n, self._dtype)
        trouble = _assemble(
            run.rows, np.uint64(run.epoch << 32), self._clock.mapped, *self._clock.line,
            run.arrival_ns, unix_minus_monotonic_ns, self.delivered > 0, self._next_seq,
            *self._unwrapper.memory, out, jumped,
        )  # fmt: skip
        self.delivered += n
        if not trouble and not self._status_watch.active and not self._jump_watch.active:
            return [out]
        status = run.rows["joint_status"].astype(np.uint16)
        return [
            *self._status_watch.events(out, status),
            *self._jump_watch.events(out, jumped),
            out,
        ]

    def warm_up(self) -> None:
        """Compile, or load from the cache: before the first sample, not while it waits."""
        n_joints = self._dtype["count"].shape[0]
        other = SampleAssembler(n_joints, self._clock, self._max_rate)
        other.set_bits([20] * n_joints)
        other.assemble(Run(np.zeros(1, row_layout(n_joints)), 0, 0, False), 0)
        self._clock.to_host(0)


@jit
def _assemble(
    rows: Any, epoch: Any, mapped: bool, anchor_device_ns: int, anchor_host_ns: int, drift: float,
    arrival_ns: int, unix_minus_monotonic_ns: int, follows: bool, next_seq: Any,
    range_counts: Any, counts_per_us: Any, memory: Any, out: Any, jumped: Any,
) -> int:  # fmt: skip
    """Fill *out*, and *jumped* with the bits of joints whose counts did; whether any joint of any
    row is in trouble. *next_seq* (1,) is the number that would follow the last one, if any."""
    last_ns = np.int64(rows[len(rows) - 1].t_us) * 1000
    trouble = 0
    for i in range(len(rows)):
        row, sample = rows[i], out[i]
        seq, t_us = epoch | np.uint64(row.seq), np.int64(row.t_us)
        device_ns = t_us * 1000
        if mapped:
            monotonic_ns = host_ns(device_ns, anchor_device_ns, anchor_host_ns, drift)
        else:
            monotonic_ns = arrival_ns - (last_ns - device_ns)
        status = np.uint16(row.joint_status)
        jumps = unwrap(row.count, t_us, status, range_counts, counts_per_us, memory, sample.count)
        sample.seq = seq
        sample.device_ns = device_ns
        sample.stamp_ns = monotonic_ns + unix_minus_monotonic_ns
        sample.monotonic_ns = monotonic_ns
        sample.joint_invalid = status | jumps
        sample.joint_warning = 0
        sample.buttons = row.buttons
        sample.clock_mapped = mapped
        sample.lost_before = follows and seq != next_seq[0]
        next_seq[0] = seq + np.uint64(1)
        follows = True
        jumped[i] = jumps
        trouble |= status | jumps
    return trouble

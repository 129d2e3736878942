"""Accepted packets → samples: unwrapped counts, host time, what is invalid, what was lost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.drivers.clock import DeviceClock
from armd.drivers.joint_watch import JointWatch
from armd.drivers.sample import Item, sample_dtype
from armd.drivers.sequence import Run
from armd.drivers.unwrap import Unwrapper


class SampleAssembler:
    """Fills `SampleArray`s of one arm; `delivered` counts their rows."""

    def __init__(self, n_joints: int, clock: DeviceClock, max_joint_rate_deg_s: float) -> None:
        self.delivered = 0
        self._dtype = sample_dtype(n_joints)
        self._clock = clock
        self._max_rate = max_joint_rate_deg_s
        self._unwrapper: Unwrapper | None = None
        self._last_seq: int | None = None
        self._status_watch = JointWatch("joint_invalid", "the arm calls it invalid")
        self._jump_watch = JointWatch("count_jump", "its count jumped")

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
        rows = run.rows
        out = np.zeros(len(rows), self._dtype)
        t_us = rows["t_us"].astype(np.int64)
        out["seq"] = run.seq
        out["device_ns"] = device_ns = t_us * 1000
        out["clock_mapped"] = self._clock.mapped
        out["monotonic_ns"] = monotonic_ns = (
            self._clock.to_host(device_ns)
            if self._clock.mapped
            else run.arrival_ns - (device_ns[-1] - device_ns)
        )
        out["stamp_ns"] = monotonic_ns + unix_minus_monotonic_ns
        out["buttons"] = rows["buttons"]
        status = rows["joint_status"].astype(np.uint16)
        out["count"], jumped = self._unwrapper(rows["count"].astype(np.int64), t_us, status)
        out["joint_invalid"] = status | jumped
        if len(rows) > 1:
            out["lost_before"][1:] = run.seq[1:] != run.seq[:-1] + np.uint64(1)
        if self._last_seq is not None:
            out["lost_before"][0] = int(run.seq[0]) != self._last_seq + 1
        self._last_seq = int(run.seq[-1])
        self.delivered += len(rows)
        return [
            *self._status_watch.events(out, status),
            *self._jump_watch.events(out, jumped),
            out,
        ]

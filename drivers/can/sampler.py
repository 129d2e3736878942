"""Turns complete cycles into samples: unwrapped counts, invalid and warning joints, lost cycles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.drivers.can.cycle import SyncCycle
from armd.drivers.can.node import Node
from armd.drivers.joint_watch import JointWatch
from armd.drivers.sample import Item, RawFrame, SampleArray, sample_dtype
from armd.drivers.unwrap import Unwrapper


class CycleSampler:
    """Makes one `SampleArray` of each cycle of the encoders *joints*."""

    def __init__(self, joints: Sequence[Node], max_joint_rate_deg_s: float) -> None:
        self.delivered = 0
        self.lost = 0
        self.first_latch_ns: int | None = None  # the origin of `device_ns`
        self._joints = joints
        self._max_rate = max_joint_rate_deg_s
        self._dtype = sample_dtype(len(joints))
        self._raw_counts = np.zeros(len(joints), np.int64)
        self._unwrapper: Unwrapper | None = None
        self._last_number: int | None = None
        self._alarm_watch = JointWatch(
            "joint_invalid", "its encoder raises an alarm", "its alarm is over"
        )
        self._jump_watch = JointWatch("count_jump", "its count jumped", "it jumps no more")

    @property
    def ready(self) -> bool:
        """Whether the ranges of all encoders have been known at least once."""
        return self._unwrapper is not None

    def learn_ranges(self) -> bool:
        """Return True once: when the last encoder's range has become known."""
        if self.ready or not all(joint.range_counts for joint in self._joints):
            return False
        self._unwrapper = Unwrapper(
            [joint.range_counts for joint in self._joints],
            [joint.counts_per_turn for joint in self._joints],
            self._max_rate,
        )
        return True

    def sample(self, cycle: SyncCycle, frame: RawFrame) -> list[Item]:
        """Return the sample of the cycle that *frame* completed, after the events of its joints."""
        assert self._unwrapper is not None
        invalid = alarmed = warned = 0
        for k, node in enumerate(self._joints):
            reading = cycle.readings.get(node.number)
            if reading is None or not node.reporting:
                invalid |= 1 << k
                continue
            self._raw_counts[k] = reading.position
            alarmed |= (reading.alarms != 0) << k
            warned |= (node.warnings != 0) << k
        if self.first_latch_ns is None:
            self.first_latch_ns = cycle.latch_ns
        out: SampleArray = np.zeros(1, self._dtype)
        out["seq"] = cycle.number
        out["device_ns"] = cycle.latch_ns - self.first_latch_ns
        out["monotonic_ns"] = cycle.latch_ns
        out["stamp_ns"] = cycle.latch_ns + frame.unix_ns - frame.monotonic_ns
        out["clock_mapped"] = True
        bad = np.array([invalid | alarmed], np.uint16)
        out["count"], jumped = self._unwrapper(
            self._raw_counts[None, :], np.array([cycle.latch_ns // 1000]), bad
        )
        out["joint_invalid"] = bad | jumped
        out["joint_warning"] = warned
        if self._last_number is not None:
            gap = cycle.number - self._last_number - 1
            out["lost_before"] = gap != 0
            self.lost += gap
        self._last_number = cycle.number
        self.delivered += 1
        return [
            *self._alarm_watch.events(out, np.array([alarmed], np.uint16)),
            *self._jump_watch.events(out, jumped),
            out,
        ]

"""Set the flags of a point, sample by sample (armd.Flag describes each)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armd import Flag
from armd.compensation.model.arm import Arm
from armd.compiled.jit import jit
from armd.daemon.live.motion import REST_AFTER_NS

END_STOP_DEG = 0.5

_INVALID = int(Flag.INVALID)
_STALE = int(Flag.TEMPERATURE_STALE)
_WARNING = int(Flag.JOINT_WARNING)
_END_STOP = int(Flag.END_STOP)
_LOST = int(Flag.SAMPLES_LOST)
_CLOCK = int(Flag.CLOCK)
_REST = int(Flag.AT_REST)


class Flagger:
    """The data of one arm for `set_flags`, kept between batches of any size."""

    def __init__(self, arm: Arm) -> None:
        low, high = arm.limits_rad
        stop = math.radians(END_STOP_DEG)
        self.memory = np.zeros(1, _memory(arm.n_joints))
        self.memory["low"], self.memory["high"] = low + stop, high - stop
        self.memory["last_seq"] = -1

    def judge_by(
        self, slow: Flag, stale_after_ns: int, invalid_after_ns: int, calibration: int
    ) -> None:
        """Set the flags and limits that hold from the next sample on.

        *slow* are the flags of all samples, which change only with a temperature or a calibration
        (TEMPERATURE_RANGE, TEMPERATURE_RATE, NOT_CALIBRATED). After *stale_after_ns* the
        temperature is stale; after *invalid_after_ns* points are invalid.
        """
        self.memory["slow"] = int(slow)
        self.memory["stale_after_ns"] = stale_after_ns
        self.memory["invalid_after_ns"] = invalid_after_ns
        self.memory["calibration"] = calibration


def _memory(n_joints: int) -> np.dtype[np.void]:
    """Return the dtype of the memory: one record, because one array costs as much as two numbers.

    This is the cost of passing it to the compiled call.
    """
    return np.dtype(
        [
            ("low", "f8", (n_joints,)),  # rad, limits of the joints
            ("high", "f8", (n_joints,)),
            ("last_seq", "i8"),  # −1: none
            ("slow", "i8"),
            ("stale_after_ns", "i8"),
            ("invalid_after_ns", "i8"),
            ("calibration", "u8"),
        ]
    )


@jit
def set_flags(samples: Any, q: Any, still_since_ns: Any, memory: Any, points: Any) -> None:
    """Flag the points (n,) of samples with angles (n, N) rad, and copy the samples' fields.

    An invalid point's numbers become NaN. *memory* is a `Flagger`'s.
    """
    state = memory[0]
    for i in range(len(samples)):
        sample, point = samples[i], points[i]
        now, seq = sample.monotonic_ns, np.int64(sample.seq)
        flag = state.slow
        if sample.joint_invalid != 0 or now > state.invalid_after_ns or not _is_finite(point):
            flag |= _INVALID
            for part in range(3):
                point.position_mm[part] = math.nan
                point.correction_mm[part] = math.nan
            for part in range(4):
                point.orientation[part] = math.nan
            for part in range(6):
                point.covariance_mm2[part] = math.nan
        elif now - still_since_ns[i] >= REST_AFTER_NS:
            flag |= _REST
        if now > state.stale_after_ns:
            flag |= _STALE
        if sample.joint_warning != 0:
            flag |= _WARNING
        for k in range(q.shape[1]):
            if q[i, k] < state.low[k] or q[i, k] > state.high[k]:
                flag |= _END_STOP
        if state.last_seq >= 0 and seq != state.last_seq + 1:
            flag |= _LOST
        if not sample.clock_mapped:
            flag |= _CLOCK
        state.last_seq = seq
        point.flags = flag
        point.seq = sample.seq
        point.stamp_ns = sample.stamp_ns
        point.monotonic_ns = now
        point.buttons = sample.buttons
        point.calibration = state.calibration


@jit
def _is_finite(point: Any) -> bool:
    """Return whether all numbers of a point are finite.

    An unknown covariance is NaN throughout; a covariance with only some NaN has overflowed. The sum
    of all is finite only if each is: one test instead of sixteen.
    """
    total = 0.0
    for part in range(3):
        total += abs(point.position_mm[part]) + abs(point.correction_mm[part])
    for part in range(4):
        total += abs(point.orientation[part])
    n_known = 0
    for part in range(6):
        if not math.isnan(point.covariance_mm2[part]):
            total += abs(point.covariance_mm2[part])
            n_known += 1
    return math.isfinite(total) and n_known in (0, 6)

"""The ten flags of a point, decided sample by sample (armd.Flag tells what each means)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from armd import Flag
from armd.compensation.arm import Arm
from armd.daemon.motion import REST_AFTER_NS
from armd.jit import jit

F64 = npt.NDArray[np.float64]

END_STOP_DEG = 0.5

_INVALID = int(Flag.INVALID)
_STALE = int(Flag.TEMPERATURE_STALE)
_WARNING = int(Flag.JOINT_WARNING)
_END_STOP = int(Flag.END_STOP)
_LOST = int(Flag.SAMPLES_LOST)
_CLOCK = int(Flag.CLOCK)
_REST = int(Flag.AT_REST)


class Flagger:
    """What `finish` must know of one arm, and remembers between batches of any size."""

    def __init__(self, arm: Arm) -> None:
        limits = [(joint.min_deg, joint.max_deg) for joint in arm.joint]
        low = np.array(
            [-math.inf if low is None else math.radians(low + END_STOP_DEG) for low, _ in limits]
        )
        high = np.array(
            [math.inf if high is None else math.radians(high - END_STOP_DEG) for _, high in limits]
        )
        #: Limits (N,) rad of the joints, and the last sample's number.
        self.memory: tuple[F64, F64, npt.NDArray[np.int64]] = (low, high, np.full(1, -1, np.int64))


@jit
def finish(
    samples: Any, q: Any, still_since_ns: Any, slow: int, stale_after_ns: int,
    invalid_after_ns: int, calibration: Any, low: Any, high: Any, last_seq: Any, points: Any,
) -> None:  # fmt: skip
    """Flag the points (n,) of samples with angles (n, N) rad, and copy what is the samples'.

    An invalid point's numbers become NaN. *slow* holds for the whole batch: flags 1, 3 and 7, which
    change with a temperature or a calibration. After the two instants the temperature is stale, and
    held no longer. *low*, *high* and *last_seq* are a `Flagger`'s memory.
    """
    for i in range(len(samples)):
        sample, point = samples[i], points[i]
        now, seq = sample.monotonic_ns, np.int64(sample.seq)
        flag = slow
        if sample.joint_invalid != 0 or now > invalid_after_ns:
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
        if now > stale_after_ns:
            flag |= _STALE
        if sample.joint_warning != 0:
            flag |= _WARNING
        for k in range(q.shape[1]):
            if q[i, k] < low[k] or q[i, k] > high[k]:
                flag |= _END_STOP
        if last_seq[0] >= 0 and seq != last_seq[0] + 1:
            flag |= _LOST
        if not sample.clock_mapped:
            flag |= _CLOCK
        last_seq[0] = seq
        point.flags = flag
        point.seq = sample.seq
        point.stamp_ns = sample.stamp_ns
        point.monotonic_ns = now
        point.buttons = sample.buttons
        point.calibration = calibration

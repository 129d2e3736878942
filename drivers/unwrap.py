"""Unwraps encoder counts, and marks counts that are implausible.

One plain loop, compiled, applies the same rule to one sample and to a million.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from armd.arrays import I64
from armd.compiled.jit import jit

MAX_JOINT_RATE_DEG_S = 1200.0  # a wrist spun by hand stays below three turns a second
MARGIN_COUNTS = 4  # noise, and the granularity of the time stamps
SETTLE_SAMPLES = 5  # after a jump, at most this many more are withheld

#: The state of each joint between two samples; counts are unwrapped.
_MEMORY = np.dtype(
    [
        ("range_counts", "i8"),
        ("counts_per_us", "f8"),  # at the highest plausible rate
        ("started", "?"),
        ("believed", "i8"),  # the last believed reading
        ("believed_us", "i8"),
        ("reading", "i8"),  # the last reading, believed or not
        ("reading_us", "i8"),
        ("doubt", "i8"),  # samples until an implausible reading is believed; 0: none in doubt
        ("may_return", "?"),  # after a single jump the old count may come back
    ]
)


@jit
def unwrap(raw: Any, now: Any, withheld: Any, memory: Any, out: Any) -> Any:
    """Unwrap one cycle: counts (N,) at *now* µs into *out*; return the bits of joints that jumped.

    *memory* belongs to an `Unwrapper`.
    """
    jumped = np.uint16(0)
    for k in range(len(raw)):
        joint = memory[k]
        reading = np.int64(raw[k])
        span = joint.range_counts
        half = span // 2
        if not joint.started:
            joint.believed = (reading + half) % span - half
            joint.believed_us = now
            joint.reading = joint.believed
        from_believed = (reading - joint.believed + half) % span - half
        count = joint.believed + from_believed
        out[k] = count
        if withheld >> k & 1:
            continue
        joint.started = True

        bound = MARGIN_COUNTS + joint.counts_per_us * (now - joint.believed_us)
        plausible = abs(from_believed) <= bound or half <= bound
        if joint.doubt == 0:
            if not plausible:
                joint.doubt = SETTLE_SAMPLES + 1
                joint.may_return = True
        elif plausible and joint.may_return:
            joint.doubt = 0
        else:
            step = (reading - joint.reading + half) % span - half
            steady = MARGIN_COUNTS + joint.counts_per_us * (now - joint.reading_us)
            if abs(step) > steady:  # another jump: this encoder is unstable
                joint.doubt = SETTLE_SAMPLES + 1
                joint.may_return = False
            else:
                joint.doubt -= 1

        joint.reading = count
        joint.reading_us = now
        if joint.doubt == 0:
            joint.believed = count
            joint.believed_us = now
        else:
            jumped |= np.uint16(1 << k)
    return jumped


@jit
def _unwrap_all(raw: Any, t_us: Any, withheld: Any, memory: Any, out: Any, jumped: Any) -> None:
    for row in range(len(raw)):
        jumped[row] = unwrap(raw[row], t_us[row], withheld[row], memory, out[row])


class Unwrapper:
    """Unwraps counts modulo *range_counts* to counts that continue over the turns.

    The first reading of a joint lies between −half and +half of its range. A reading is a jump if
    it differs from the last believed one by more than *max_rate_deg_s* allows. It and at most
    `SETTLE_SAMPLES` after it are reported as jumps; then the new reading is believed. If the old
    reading comes back, it is believed at once. A reading that the arm itself calls invalid is
    neither believed nor compared with.
    """

    def __init__(
        self,
        range_counts: Sequence[int],
        counts_per_turn: Sequence[int],
        max_rate_deg_s: float = MAX_JOINT_RATE_DEG_S,
    ) -> None:
        self._fresh = np.zeros(len(range_counts), _MEMORY)
        self._fresh["range_counts"] = range_counts
        self._fresh["counts_per_us"] = np.array(counts_per_turn) * (max_rate_deg_s / 360.0 / 1e6)
        self.restart()

    def restart(self) -> None:
        """Forget all readings: the turns are unknown again."""
        self.memory = self._fresh.copy()  # the state that `unwrap` reads and updates

    def __call__(
        self,
        raw: I64,
        t_us: I64,
        invalid: npt.NDArray[np.uint16],
    ) -> tuple[I64, npt.NDArray[np.uint16]]:
        """Unwrap *raw* (m, N) counts at *t_us* (m,), which rise; *invalid* (m,) are bits of joints.

        Returns the unwrapped counts (m, N), and which of them jumped (m,): bit k-1 for joint k.
        """
        out = np.empty_like(raw)
        jumped = np.zeros(len(raw), dtype=np.uint16)
        _unwrap_all(raw, t_us, invalid, self.memory, out, jumped)
        return out, jumped


def load_compiled() -> None:
    """Compile the loop, or load it from the cache, before the first sample arrives."""
    Unwrapper([2], [2])(np.zeros((1, 1), np.int64), np.zeros(1, np.int64), np.zeros(1, np.uint16))

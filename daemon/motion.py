"""What joints and tip are doing: rates and sides of approach, direction of travel, rest.

Everything here is decided sample by sample from the counts and the stream's own monotonic_ns, so
that a replay gives the same answers however the bytes were cut into batches.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from armd.jit import jit

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

REST_AFTER_NS = 500_000_000
#: The tip counts as moving above this speed; the contract's bound is 10 mm/s.
MOVING_MM_S = 8.0
#: A hand that presses a probe into a seat trembles by this much.
TREMOR_MM = 0.01
#: After a longer gap nobody knows what the tip did meanwhile: rates and rests start anew.
GAP_NS = 100_000_000
#: A joint has turned back when it comes back by this much; less is noise.
SIDE_PLAY_RAD = 4e-5
#: Carries a joint's side while it rests.
NO_RATE_RAD_S = 1e-12
#: The tip drags its direction of travel behind it on a string of this length.
TRAIL_MM = 0.2
#: Samples over which the noise of the position is learnt, and over which a rest's mean follows.
NOISE_SAMPLES = 100.0
MEAN_SAMPLES = 2000.0

# State kept between batches, one row of floats and one of integers, so that numba can hold it.
_MEAN, _LAST, _BEFORE, _TRAIL, _DIRECTION, _VARIANCE, _COUNT = 0, 3, 6, 9, 12, 15, 16
_SEEN, _LAST_NS, _STILL_NS = 0, 1, 2


class Motion:
    """What is remembered of one arm's motion; `follow` goes on from it, in batches of any size."""

    def __init__(self, counts_per_turn: list[int], reach_mm: float) -> None:
        """*reach_mm*: longest lever from a joint to the tip, which turns a count into mm."""
        n = len(counts_per_turn)
        resolution_mm = reach_mm * 2 * math.pi / min(counts_per_turn)
        floor_mm = 1.5 * resolution_mm  # one count to and fro is not a motion
        #: What `follow` takes and keeps.
        self.memory: tuple[float, F64, I64, F64, F64, F64] = (
            floor_mm, np.zeros(17), np.zeros(3, np.int64), np.zeros(n), np.zeros(n), np.zeros(n),
        )  # fmt: skip


@jit
def follow(
    samples: Any, q: Any, position: Any,
    floor: float, state: Any, clock: Any, last_q: Any, turned_q: Any, sides: Any,
    rate: Any, approach: Any, still_since: Any,
) -> None:  # fmt: skip
    """Samples (n,) with their joint angles (n, N) rad and tips (n, 3) mm, and a `Motion`'s memory.

    Fills *rate* (n, N) rad/s whose sign is the side of approach (at rest it stays, on a value of
    almost 0; NaN while unknown), *approach* (n, 3) unit vectors (NaN while unknown) and the instant
    (n,) ns since which the tip has been still.
    """
    n, joints = q.shape
    for i in range(n):
        now = samples[i].monotonic_ns
        if samples[i].joint_invalid != 0:
            clock[_SEEN] = 0
            still_since[i] = now
            for k in range(joints):
                rate[i, k] = math.nan
            for axis in range(3):
                approach[i, axis] = math.nan
            continue
        dt_ns = now - clock[_LAST_NS]
        if clock[_SEEN] == 0 or dt_ns > GAP_NS or dt_ns <= 0:
            clock[_SEEN] = 0
            clock[_STILL_NS] = now
            state[_COUNT] = 0.0
        seen = clock[_SEEN]
        dt = dt_ns * 1e-9

        for k in range(joints):
            if seen == 0 and sides[k] == 0.0:
                turned_q[k] = q[i, k]
            _turn(k, q[i, k], turned_q, sides)
            measured = (q[i, k] - last_q[k]) / dt if seen > 0 else 0.0
            rate[i, k] = math.nan
            if sides[k] != 0.0:
                rate[i, k] = sides[k] * max(measured * sides[k], NO_RATE_RAD_S)
            last_q[k] = q[i, k]

        step = 0.0
        jerk = 0.0
        away = 0.0
        for axis in range(3):
            here = position[i, axis]
            step += (here - state[_LAST + axis]) ** 2
            jerk += (here - 2.0 * state[_LAST + axis] + state[_BEFORE + axis]) ** 2
            away += (here - state[_MEAN + axis]) ** 2
            state[_BEFORE + axis] = state[_LAST + axis]
            state[_LAST + axis] = here
        if seen > 1:  # second differences see noise (variance 6 s² an axis), hardly motion
            state[_VARIANCE] += (jerk / 18.0 - state[_VARIANCE]) / min(NOISE_SAMPLES, seen)
        noise = max(6.0 * math.sqrt(state[_VARIANCE]), floor)
        moved = seen > 0 and (
            math.sqrt(step) > MOVING_MM_S * dt + 1.4 * noise or math.sqrt(away) > TREMOR_MM + noise
        )
        if moved:
            clock[_STILL_NS] = now
            state[_COUNT] = 0.0
        state[_COUNT] = min(state[_COUNT] + 1.0, MEAN_SAMPLES)
        for axis in range(3):
            offset = position[i, axis] - state[_MEAN + axis]
            state[_MEAN + axis] += offset / state[_COUNT]
        still_since[i] = clock[_STILL_NS]

        _drag(position[i], seen, state)
        for axis in range(3):
            approach[i, axis] = state[_DIRECTION + axis]
        clock[_SEEN] = seen + 1
        clock[_LAST_NS] = now


@jit
def _turn(k: int, q: float, turned_q: Any, sides: Any) -> None:
    """Side of approach with play: `turned_q` is the farthest point reached on this side."""
    beyond = q - turned_q[k]
    if sides[k] == 0.0:
        if abs(beyond) > SIDE_PLAY_RAD:
            sides[k] = math.copysign(1.0, beyond)
            turned_q[k] = q
    elif beyond * sides[k] > 0.0:
        turned_q[k] = q
    elif beyond * sides[k] < -SIDE_PLAY_RAD:
        sides[k] = -sides[k]
        turned_q[k] = q


@jit
def _drag(position: Any, seen: int, state: Any) -> None:
    """The direction of travel: from a point dragged behind the tip, held while it rests."""
    if seen == 0:
        for axis in range(3):
            state[_TRAIL + axis] = position[axis]
            state[_DIRECTION + axis] = math.nan
        return
    length = 0.0
    for axis in range(3):
        length += (position[axis] - state[_TRAIL + axis]) ** 2
    length = math.sqrt(length)
    if length > TRAIL_MM:
        for axis in range(3):
            direction = (position[axis] - state[_TRAIL + axis]) / length
            state[_DIRECTION + axis] = direction
            state[_TRAIL + axis] = position[axis] - TRAIL_MM * direction

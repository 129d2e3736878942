"""Compute the motion of joints and tip: rates, sides of approach, travel, rest.

Everything is decided sample by sample from the counts and the stream's own monotonic_ns. So a
replay gives the same result however the bytes were cut into batches.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armd.compiled.jit import jit

REST_AFTER_NS = 500_000_000
#: The tip counts as moving above this speed; the contract's bound is 10 mm/s.
MOVING_MM_S = 8.0
#: Tremor of a hand that presses a probe into a seat.
TREMOR_MM = 0.01
#: Where samples are missing for longer, the tip's motion is unknown: rates and rests start again.
#: Without missing samples an arm may send fewer than ten a second …
GAP_NS = 100_000_000
#: … but a rest cannot be detected from less than one a second.
LONG_GAP_NS = 1_000_000_000
#: A joint has turned back when it returns by this much; less is noise.
SIDE_PLAY_RAD = 4e-5
#: A coarse encoder, whose single count moves the tip by tenths of a millimetre, flickers by one
#: count to either side, sometimes by two. Its average over this time hardly changes by that.
COARSE_BELOW_PER_TURN, COARSE_LATELY_S = 1 << 15, 0.01
#: A motion if the average is so many counts from a rest's mean, that is in the second count; more
#: counts where rows are so far apart that the average is of few (docs/decisions/0013).
COARSE_COUNTS, COARSE_COUNTS_ALONE = 1.1, 1.6
#: Where several such joints turn together, possibly none is two counts away. Then it is a motion if
#: the tip is farther from the rest's mean than so many counts at full reach.
COARSE_TIP_COUNTS = 1.1
#: Rate of a joint at rest: its sign carries the side of approach.
NO_RATE_RAD_S = 1e-12
#: Length of the line from the tip to the point dragged behind it, which gives the direction.
TRAIL_MM = 0.2
#: Samples over which the position's noise is estimated, and over which a rest's mean is taken.
NOISE_SAMPLES = 100.0
MEAN_SAMPLES = 2000.0


class Motion:
    """The memory of one arm's motion, which `follow` continues in batches of any size."""

    def __init__(self, counts_per_turn: list[int], reach_mm: float) -> None:
        """Set up; *reach_mm* is the longest lever from a joint to the tip.

        It converts a count to mm.
        """
        resolution_mm = reach_mm * 2 * math.pi / min(counts_per_turn)
        self.memory = np.zeros(1, _memory(len(counts_per_turn)))
        self.memory["floor_mm"] = 1.5 * resolution_mm  # a flicker of one count is not a motion
        count_rad = 2 * math.pi / np.array(counts_per_turn)
        coarse = np.array(counts_per_turn) < COARSE_BELOW_PER_TURN
        self.memory["coarse"] = coarse.any()
        self.memory["coarse_mm"] = COARSE_TIP_COUNTS * resolution_mm
        self.memory["count_rad"] = np.where(coarse, count_rad, math.inf)
        self.memory["play_rad"] = np.maximum(SIDE_PLAY_RAD, 1.5 * count_rad)


def _memory(n_joints: int) -> np.dtype[np.void]:
    """Return the dtype of the memory: one record, because one array costs as much as two numbers.

    This is the cost of passing it to the compiled call.
    """
    return np.dtype(
        [
            ("floor_mm", "f8"),
            ("mean", "f8", (3,)),  # mm: mean of the tip at rest, over `count` samples
            ("count", "f8"),
            ("last", "f8", (3,)),  # mm: the tip one and two samples ago
            ("before", "f8", (3,)),
            ("trail", "f8", (3,)),  # mm: the point dragged behind the tip
            ("direction", "f8", (3,)),
            ("variance", "f8"),  # mm²: noise of the position
            ("n_seen", "i8"),  # samples since the last gap
            ("last_ns", "i8"),
            ("last_seq", "i8"),
            ("still_ns", "i8"),
            ("last_q", "f8", (n_joints,)),  # rad
            ("turned_q", "f8", (n_joints,)),  # rad: the farthest point reached on this side
            ("sides", "f8", (n_joints,)),  # ±1, 0 unknown
            ("play_rad", "f8", (n_joints,)),  # a smaller change of direction is noise
            ("coarse", "?"),  # whether any encoder is
            ("coarse_mm", "f8"),  # distance of `lately` from `mean` that is a motion
            ("lately", "f8", (3,)),  # mm: the tip's average over `COARSE_LATELY_S`
            ("count_rad", "f8", (n_joints,)),  # of a coarse encoder, else infinite
            ("lately_q", "f8", (n_joints,)),  # rad: like `lately`, of joints
            ("mean_q", "f8", (n_joints,)),  # rad: like `mean`, of joints
        ]
    )


@jit
def follow(
    samples: Any, q: Any, position: Any, memory: Any, rate: Any, approach: Any, still_since: Any
) -> None:
    """Compute rates, directions of travel and rests of samples (n,), from a `Motion`'s memory.

    *q* (n, N) rad are their joint angles, *position* (n, 3) mm their tips. Fills *rate* (n, N)
    rad/s, whose sign is the side of approach (at rest the sign stays, with a value of almost 0; NaN
    while unknown), *approach* (n, 3) unit vectors (NaN while unknown) and *still_since* (n,) ns,
    the instant since which the tip has been still.
    """
    state = memory[0]
    mean, last, before, sides = state.mean, state.last, state.before, state.sides
    n, joints = q.shape
    for i in range(n):
        now = samples[i].monotonic_ns
        if samples[i].joint_invalid != 0:
            state.n_seen = 0
            still_since[i] = now
            for k in range(joints):
                rate[i, k] = math.nan
            for axis in range(3):
                approach[i, axis] = math.nan
            continue
        dt_ns = now - state.last_ns
        missed = np.int64(samples[i].seq) != state.last_seq + 1
        gap_ns = GAP_NS if missed else LONG_GAP_NS
        if state.n_seen == 0 or dt_ns > gap_ns or dt_ns <= 0:
            state.n_seen = 0
            state.still_ns = now
            state.count = 0.0
        n_seen = state.n_seen
        dt = dt_ns * 1e-9

        for k in range(joints):
            if n_seen == 0 and sides[k] == 0.0:
                state.turned_q[k] = q[i, k]
            _turn(k, q[i, k], state)
            measured = (q[i, k] - state.last_q[k]) / dt if n_seen > 0 else 0.0
            rate[i, k] = math.nan
            if sides[k] != 0.0:
                rate[i, k] = sides[k] * max(measured * sides[k], NO_RATE_RAD_S)
            state.last_q[k] = q[i, k]

        step = 0.0
        jerk = 0.0
        away = 0.0
        for axis in range(3):
            coordinate = position[i, axis]
            step += (coordinate - last[axis]) ** 2
            jerk += (coordinate - 2.0 * last[axis] + before[axis]) ** 2
            away += (coordinate - mean[axis]) ** 2
            before[axis] = last[axis]
            last[axis] = coordinate
        if n_seen > 1:  # second differences: noise (variance 6 s² an axis), hardly any motion
            state.variance += (jerk / 18.0 - state.variance) / min(NOISE_SAMPLES, n_seen)
        noise = max(6.0 * math.sqrt(state.variance), state.floor_mm)
        moved = (
            not state.coarse
            and n_seen > 0
            and (
                math.sqrt(step) > MOVING_MM_S * dt + 1.4 * noise
                or math.sqrt(away) > TREMOR_MM + noise
            )
        )
        if state.coarse:
            gain = min(1.0, dt / COARSE_LATELY_S) if state.count > 0.0 else 1.0
            away = 0.0
            for axis in range(3):
                state.lately[axis] += gain * (position[i, axis] - state.lately[axis])
                away += (state.lately[axis] - mean[axis]) ** 2
            if state.count > 0.0:
                moved = math.sqrt(away) > TREMOR_MM + state.coarse_mm
            threshold = COARSE_COUNTS + (COARSE_COUNTS_ALONE - COARSE_COUNTS) * gain
            for k in range(joints):
                state.lately_q[k] += gain * (q[i, k] - state.lately_q[k])
                if not moved and state.count > 0.0:
                    moved = (
                        abs(state.lately_q[k] - state.mean_q[k]) > threshold * state.count_rad[k]
                    )
        if moved:
            state.still_ns = now
            state.count = 0.0
        state.count = min(state.count + 1.0, MEAN_SAMPLES)
        for axis in range(3):
            mean[axis] += (position[i, axis] - mean[axis]) / state.count
        if state.coarse:
            for k in range(joints):
                state.mean_q[k] += (q[i, k] - state.mean_q[k]) / state.count
        still_since[i] = state.still_ns

        _drag(position[i], state)
        for axis in range(3):
            approach[i, axis] = state.direction[axis]
        state.n_seen = n_seen + 1
        state.last_ns = now
        state.last_seq = samples[i].seq


@jit
def _turn(k: int, q: float, state: Any) -> None:
    """Update a joint's side of approach, with backlash.

    `turned_q` is the farthest point reached on this side.
    """
    sides, turned_q = state.sides, state.turned_q
    beyond = q - turned_q[k]
    if sides[k] == 0.0:
        if abs(beyond) > state.play_rad[k]:
            sides[k] = math.copysign(1.0, beyond)
            turned_q[k] = q
    elif beyond * sides[k] > 0.0:
        turned_q[k] = q
    elif beyond * sides[k] < -state.play_rad[k]:
        sides[k] = -sides[k]
        turned_q[k] = q


@jit
def _drag(position: Any, state: Any) -> None:
    """Update the direction of travel, from a point dragged behind the tip; it stays at rest."""
    trail, direction = state.trail, state.direction
    if state.n_seen == 0:
        for axis in range(3):
            trail[axis] = position[axis]
            direction[axis] = math.nan
        return
    length = 0.0
    for axis in range(3):
        length += (position[axis] - trail[axis]) ** 2
    length = math.sqrt(length)
    if length > TRAIL_MM:
        for axis in range(3):
            direction[axis] = (position[axis] - trail[axis]) / length
            trail[axis] = position[axis] - TRAIL_MM * direction[axis]

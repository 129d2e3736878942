"""The motion of the servos at any instant, in closed form: a wandering hand, or a planned one."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable

import numpy as np

from armd.arrays import F64
from armd.simulator.live.operator import Stretch

PRESS_S = 0.2  # how long the button is pressed


class ServoMotion:
    """Stretches, one after the other, planned as far as an instant was asked for."""

    def __init__(self, first: Stretch, plan_next: Callable[[Stretch], Stretch]) -> None:
        self._stretches, self._starts = [first], [first.start_s]
        self._plan_next = plan_next

    def angle(self, joint: int, time_s: float) -> float:
        """Return the angle of *joint* (from 1), rad, as in the drawing."""
        now = self._stretch_at(time_s)
        u = min((time_s - now.start_s) / now.move_s, 1.0)
        profile = u**3 * (10.0 + u * (-15.0 + 6.0 * u))
        return float(now.begin[joint - 1] + now.change[joint - 1] * profile)

    def pressed(self, time_s: float) -> bool:
        now = self._stretch_at(time_s)
        return 0.0 <= time_s - now.start_s - now.move_s - now.press_after_s < PRESS_S

    def _stretch_at(self, time_s: float) -> Stretch:
        while self._stretches[-1].end_s <= time_s:
            following = self._plan_next(self._stretches[-1])
            self._stretches.append(following)
            self._starts.append(following.start_s)
        return self._stretches[bisect_right(self._starts, time_s) - 1]


def make_wandering(seed: int, middle: F64, low: F64, high: F64) -> ServoMotion:
    """Make an endless motion through postures between *low* and *high* (N,) rad, from *middle* on.

    It is the same for the same *seed*.
    """
    rng = np.random.default_rng([seed, 0x4A4D])

    def plan_next(before: Stretch) -> Stretch:
        begin = before.begin + before.change
        change = rng.uniform(low, high) - begin
        move_s = max(float(np.abs(change).max()) * 1.875 / rng.uniform(0.8, 2.0), 0.4)
        start = before.end_s
        return Stretch(start, move_s, start + move_s + 1.6, begin, change, 0.9)

    return ServoMotion(Stretch(0.0, 1e-9, 1.5, middle, np.zeros_like(middle), 0.9), plan_next)

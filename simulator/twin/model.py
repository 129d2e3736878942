"""Computes the twin's tip: constants + Σ coefficient · basis, then the chain of joints.

Written only from docs/reference/formats.md, and by other means than the compensation's: whole
matrices, a spline of scipy. A test compares it with the kernel.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64
from armd.simulator.twin.chain import Frames, compute_frames
from armd.simulator.twin.factors import POSE, SLOW, PoseState, Slow
from armd.simulator.twin.files import ArmData, CalibrationData, as_parameters


class FirstOrderLag:
    """A value delayed by τ·dy/dt = x − y, exact if it is linear between its instants.

    It starts settled. A missing value (NaN) gives NaN and is bridged by a straight line.
    """

    def __init__(self, lag_s: float) -> None:
        self._lag_s = lag_s
        self._last: tuple[float, float, float] | None = None  # time, value, delayed value

    def delay(self, time_s: float, value: float) -> float:
        """Return the delayed value at *time_s*; ask in order of time."""
        if math.isnan(value) or math.isnan(time_s):
            return math.nan
        delayed = value
        if self._last is not None:
            before_s, before, delayed = self._last
            step_s = time_s - before_s
            if step_s > 0:
                # The lag behind a ramp of slope r is r·τ, after the initial state has decayed.
                late = (value - before) / step_s * self._lag_s
                start = delayed - (before - late)
                delayed = value - late + start * math.exp(-step_s / self._lag_s)
        self._last = (time_s, value, delayed)
        return delayed


@dataclass(frozen=True)
class RowMeans:
    """Mean temperatures of rows (n, S) °C at *unix_s* (n,), which are one run in time."""

    sensors: tuple[str, ...]
    celsius: F64
    unix_s: F64

    def mean_c(self, weights: Mapping[str, float], lag_s: float) -> F64:
        """Return the means as `factors.Means` does; rows may be in any order."""
        mean = np.zeros(len(self.celsius))
        for name, weight in weights.items():
            if weight:
                mean += weight * self.celsius[:, self.sensors.index(name)]
        if not lag_s:
            return mean
        lag, delayed = FirstOrderLag(lag_s), np.empty_like(mean)
        for i in np.argsort(self.unix_s, kind="stable"):
            delayed[i] = lag.delay(float(self.unix_s[i]), float(mean[i]))
        return delayed


class TwinModel:
    """An arm and its calibration: takes angles, returns the true tip."""

    def __init__(self, arm: ArmData, calibration: CalibrationData) -> None:
        self.arm = arm
        self.calibration = calibration
        self._constants = as_parameters(calibration.constants)
        self._drawn = as_parameters(arm.drawn)

    def slow_amounts(self, slow: Slow) -> F64:
        """Return (n, T) coefficient × factors of temperature and time of each term."""
        amounts = np.empty((len(slow.unix_s), len(self.calibration.terms)))
        for t, term in enumerate(self.calibration.terms):
            amounts[:, t] = term.coefficient
            for factor in term.slow:
                amounts[:, t] *= SLOW[factor["kind"]](factor, slow)
        return amounts

    def row_slow(self, celsius: F64, unix_s: F64) -> F64:
        """Return `slow_amounts` of rows measured one after another: (n, S) °C at (n,) s."""
        means = RowMeans(self.arm.sensors, celsius, unix_s)
        calibration = self.calibration
        return self.slow_amounts(
            Slow(means, unix_s, calibration.reference_c, calibration.created_unix_s)
        )

    def stand(self, q: F64, rate: F64, approach: F64, amounts: F64) -> Frames:
        """Return the frames of the arm at angles *q* (n, N) rad.

        *rate* (n, N) rad/s and *approach* (n, 3) may be NaN; *amounts* (n, T) are those of
        `slow_amounts`, or (T,) for all rows.
        """
        rigid = compute_frames(q, self._constants)
        pose = PoseState(q, np.nan_to_num(rate), np.nan_to_num(approach), rigid, self.arm.weights)
        values = np.tile(self.calibration.constants, (len(q), 1))
        for term, amount in zip(self.calibration.terms, np.moveaxis(amounts, -1, 0), strict=True):
            value = np.broadcast_to(amount, len(q))
            for factor in term.pose:
                value = value * POSE[factor["kind"]](factor, pose)
            values[:, term.place] += value
        return compute_frames(q, as_parameters(values))

    def direction_of_motion(self, q: F64, rate: F64) -> F64:
        """Return unit vectors (n, 3) of the nominal arm's tip motion; NaN at rest."""
        velocity = np.einsum("nij,nj->ni", compute_frames(q, self._drawn).jacobian, rate)
        speed = np.linalg.norm(velocity, axis=1, keepdims=True)
        unit: F64 = np.divide(velocity, speed, out=np.full_like(velocity, np.nan), where=speed > 0)
        return unit


def count_whole_turns(q: F64, limits_rad: tuple[F64, F64]) -> I64:
    """Count whole turns (n, N) by which angles (n, N) are outside the limits, where determined."""
    turns = np.zeros(q.shape, dtype=np.int64)
    for k, (low, high) in enumerate(zip(*limits_rad, strict=True)):
        if not math.isfinite(low) or not math.isfinite(high):
            continue
        if high - low <= math.tau * (1 + 1e-9):
            turns[:, k] = np.floor((q[:, k] - (low + high) / 2) / math.tau + 0.5)
            inside = (q[:, k] >= low) & (q[:, k] <= high)
            turns[inside, k] = 0
            continue
        fewest, largest = np.ceil((q[:, k] - high) / math.tau), np.floor((q[:, k] - low) / math.tau)
        outside = (q[:, k] < low) | (q[:, k] > high)
        turns[:, k] = np.where(outside & (fewest == largest), fewest, 0)
    return turns

"""The factors of a term's basis, by kind, as docs/reference/formats.md defines them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from armd.arrays import F64
from armd.simulator.twin.chain import Frames, LinkWeights

#: One factor, as in the calibration file.
FactorData = Mapping[str, Any]
DAY_S = 86400.0
AXES = "xyz"


class Means(Protocol):
    """Provides the mean temperatures of sensors, which may lag."""

    def mean_c(self, weights: Mapping[str, float], lag_s: float) -> F64:
        """Return Σ weight·T (n,) °C, delayed by a first-order lag."""
        ...


@dataclass(frozen=True)
class Slow:
    """The arguments of factors of temperature and time."""

    means: Means
    unix_s: F64  # (n,)
    reference_c: float
    created_unix_s: float  # of the calibration: the end of a period without one


@dataclass(frozen=True)
class PoseState:
    """The arguments of factors of the pose."""

    q: F64  # (n, N) rad
    rate: F64  # (n, N) rad/s, 0 where missing
    approach: F64  # (n, 3) unit vector, base frame, 0 where missing
    frames: Frames  # from the calibration's constants only
    weights: LinkWeights

    @cached_property
    def torque(self) -> F64:
        """The torque (N, n) Nm about each joint's axis, of everything after it."""
        axes = self.frames.rotation[:-1, :, :, 2]
        moments = [
            self.weights.moment(self.frames, self.frames.origin[k], k + 1) for k in range(len(axes))
        ]
        torque: F64 = np.einsum("kni,kni->kn", np.array(moments), axes)
        return torque

    @cached_property
    def moment(self) -> F64:
        """The moment (N, n, 3) Nm of all beyond each link, about its end, in its outgoing frame."""
        ends, rotations = self.frames.origin[1:], self.frames.rotation[1:]
        moments = [self.weights.moment(self.frames, end, k + 2) for k, end in enumerate(ends)]
        moment: F64 = np.einsum("kni,knij->knj", np.array(moments), rotations)
        return moment

    @cached_property
    def down(self) -> F64:
        """The unit vector of gravity (N, n, 3) in each link's outgoing frame."""
        down: F64 = np.einsum("i,knij->knj", self.weights.down, self.frames.rotation[1:])
        return down


def _temperature(factor: FactorData, slow: Slow) -> F64:
    mean_c = slow.means.mean_c(factor["weights"], factor.get("lag_s", 0.0))
    order = int(factor.get("order", 1))
    zone = factor.get("zone_c")
    if zone is not None:
        power: F64 = (np.clip(mean_c, *zone) - zone[0]) ** order
        return power
    reference_c = factor.get("reference_c")
    rise: F64 = mean_c - (slow.reference_c if reference_c is None else reference_c)
    return rise**order


def _temperature_rate(factor: FactorData, slow: Slow) -> F64:
    smoothing_s = factor.get("smoothing_s", 60.0)
    now = slow.means.mean_c(factor["weights"], 0.0)
    rate: F64 = (now - slow.means.mean_c(factor["weights"], smoothing_s)) / smoothing_s
    return rate


def _since_s(factor: FactorData, slow: Slow) -> F64:
    """Return the seconds since a period began; outside it, the value of the nearer end."""
    since, until = factor["since_unix_s"], factor.get("until_unix_s")
    until = max(slow.created_unix_s, since) if until is None else until
    within: F64 = np.clip(slow.unix_s, since, until) - since
    return within


def _after(factor: FactorData, slow: Slow) -> F64:
    later = (slow.unix_s >= factor["instant_unix_s"]).astype(float)
    return np.where(np.isfinite(slow.unix_s), later, np.nan)


def _curve(factor: FactorData, pose: PoseState) -> F64:
    from scipy.interpolate import CubicSpline  # loaded late: an arm on a wire may not need it

    values = np.asarray(factor["values"], dtype=float)
    knots = np.linspace(0.0, math.tau, len(values) + 1)
    spline = CubicSpline(knots, np.append(values, values[0]), bc_type="periodic")
    return np.asarray(spline(np.mod(pose.q[:, factor["joint"] - 1], math.tau)), dtype=float)


def _approach(factor: FactorData, pose: PoseState) -> F64:
    axis = AXES.index(factor["axis"])
    if factor.get("frame", "base") == "base":
        return pose.approach[:, axis]
    along_axis: F64 = (pose.approach * pose.frames.rotation[-1, :, :, axis]).sum(axis=1)
    return along_axis


SLOW: dict[str, Callable[[FactorData, Slow], F64]] = {
    "temperature": _temperature,
    "temperature_rate": _temperature_rate,
    "time": lambda factor, slow: (_since_s(factor, slow) / 3600.0) ** int(factor.get("power", 1)),
    "relaxation": lambda factor, slow: (
        1.0 - np.exp(-_since_s(factor, slow) / factor["time_constant_s"])
    ),
    "daily_sin": lambda factor, slow: np.sin(math.tau * _since_s(factor, slow) / DAY_S),
    "daily_cos": lambda factor, slow: np.cos(math.tau * _since_s(factor, slow) / DAY_S),
    "after": _after,
}
POSE: dict[str, Callable[[FactorData, PoseState], F64]] = {
    "sin": lambda factor, pose: np.sin(factor.get("order", 1) * pose.q[:, factor["joint"] - 1]),
    "cos": lambda factor, pose: np.cos(factor.get("order", 1) * pose.q[:, factor["joint"] - 1]),
    "angle": lambda factor, pose: pose.q[:, factor["joint"] - 1] ** int(factor.get("power", 1)),
    "curve": _curve,
    "gravity_torque": lambda factor, pose: pose.torque[factor["joint"] - 1],
    "gravity_direction": lambda factor, pose: pose.down[
        factor["link"] - 1, :, AXES.index(factor["axis"])
    ],
    "gravity_moment": lambda factor, pose: pose.moment[
        factor["link"] - 1, :, AXES.index(factor["axis"])
    ],
    "side": lambda factor, pose: np.sign(pose.rate[:, factor["joint"] - 1]),
    "rate": lambda factor, pose: pose.rate[:, factor["joint"] - 1],
    "approach": _approach,
}

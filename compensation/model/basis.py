"""What a term's basis is worth at each reading: plain arrays, for identification and diagnosis.

The kernel evaluates the same functions block by block for the live path; a test holds the two
together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from armd.compensation.model.arm import Arm
from armd.compensation.model.gravity import gravity_directions, gravity_moments, gravity_torques
from armd.compensation.model.kinematics import forward
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.model.state import States, lagged
from armd.compensation.model.terms import (
    After,
    Angle,
    Approach,
    Curve,
    Daily,
    Factor,
    GravityDirection,
    GravityMoment,
    GravityTorque,
    Harmonic,
    Period,
    Rate,
    Relaxation,
    Side,
    Temperature,
    TemperatureRate,
    Term,
    Time,
)

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

__all__ = ["basis_values", "curve_spline", "gravity_torques", "parameter_rows"]

F64 = npt.NDArray[np.float64]

AXES = "xyz"
DAY_S = 86400.0


#: (name by `delay_name`, temperature (n,), time (n,) s, lag s) → the temperature delayed (n,)
Delay = Callable[[str, F64, F64, float], F64]


def delay_name(weights: dict[str, float], lag_s: float) -> str:
    """What tells one delayed mean of temperatures from another."""
    return f"{weights} {lag_s}"


def basis_values(
    terms: Sequence[Term],
    states: States,
    arm: Arm,
    reference_c: float,
    constants: F64,
    delay: Delay | None = None,
) -> F64:
    """The product of each term's factors at each row, (n, T).

    *constants* (P,) pose the gravity factors and the tip's frame. A missing rate or approach
    contributes nothing (0); a missing temperature or time gives NaN. Lags are followed within each
    series of *states*, unless the live path brings its own *delay*.
    """
    basis = _Basis(states, arm, reference_c, constants, delay)
    values = np.ones((states.n, len(terms)))
    for t, term in enumerate(terms):
        for factor in term.basis:
            values[:, t] *= basis.values(factor)
    return values


def parameter_rows(constants: F64, terms: Sequence[Term], values: F64) -> F64:
    """Parameters (n, P) of each row: *constants* (P,) + Σ coefficient · *values* (n, T)."""
    layout = ParameterLayout.of(len(constants))
    rows = np.tile(constants, (len(values), 1))
    for term, value in zip(terms, values.T, strict=True):
        rows[:, layout.index(term.parameter)] += term.coefficient * value
    return rows


def curve_spline(values: Sequence[float]) -> CubicSpline[np.float64]:
    """The periodic cubic spline through values at 0, 1/n, … of a turn; argument in rad."""
    from scipy.interpolate import CubicSpline  # slow to import, and only curves need it

    turn = np.linspace(0.0, math.tau, len(values) + 1)
    return CubicSpline(turn, [*values, values[0]], bc_type="periodic")


def at_times(factor: Time | Relaxation | Daily | After, time_s: F64) -> F64:
    """A factor that depends on the date alone, at times (n,) in Unix seconds."""
    match factor:
        case Time():
            return (_held_s(factor, time_s) / 3600) ** factor.power
        case Relaxation():
            return -np.expm1(-_held_s(factor, time_s) / factor.time_constant_s)
        case Daily():
            turn = math.tau * (time_s - factor.since_unix_s) / DAY_S
            return np.sin(turn) if factor.kind == "daily_sin" else np.cos(turn)
        case After():
            return np.where(np.isfinite(time_s), time_s >= factor.instant_unix_s, np.nan)


def _held_s(factor: Period, time_s: F64) -> F64:
    """Seconds since a period began; outside it as at the nearer end."""
    until = math.inf if factor.until_unix_s is None else factor.until_unix_s
    held_s: F64 = np.clip(time_s, factor.since_unix_s, until)
    return held_s - factor.since_unix_s


class _Basis:
    """Values of factors over one set of states, each distinct factor evaluated once."""

    def __init__(
        self, states: States, arm: Arm, reference_c: float, constants: F64, delay: Delay | None
    ) -> None:
        self._states = states
        self._delay = delay or self._by_series
        self._arm = arm
        self._reference_c = reference_c
        self._constants = constants
        self._known: dict[str, F64] = {}

    def values(self, factor: Factor) -> F64:
        """One factor at each row, (n,)."""
        return self._once(factor.model_dump_json(), lambda: self._evaluate(factor))

    def _once(self, key: str, evaluate: Callable[[], F64]) -> F64:
        if key not in self._known:
            self._known[key] = evaluate()
        return self._known[key]

    def _evaluate(self, factor: Factor) -> F64:
        states, q = self._states, self._states.q
        match factor:
            case Temperature():
                return self._temperature(factor)
            case TemperatureRate():
                value = self._delayed(factor.weights, 0.0)
                return (value - self._delayed(factor.weights, factor.smoothing_s)) / (
                    factor.smoothing_s
                )
            case Time() | Relaxation() | Daily() | After():
                return at_times(factor, states.time_s)
            case Harmonic():
                wave = np.sin if factor.kind == "sin" else np.cos
                return wave(factor.order * q[:, factor.joint - 1])
            case Angle():
                return q[:, factor.joint - 1] ** factor.power
            case Curve():
                return curve_spline(factor.values)(q[:, factor.joint - 1])
            case GravityTorque():
                return self._of_pose(gravity_torques)[:, factor.joint - 1]
            case GravityDirection():
                directions = self._of_pose(gravity_directions)
                return directions[:, factor.link - 1, AXES.index(factor.axis)]
            case GravityMoment():
                return self._of_pose(gravity_moments)[:, factor.link - 1, AXES.index(factor.axis)]
            case Side():
                return np.sign(np.nan_to_num(states.rate[:, factor.joint - 1]))
            case Rate():
                return np.nan_to_num(states.rate[:, factor.joint - 1])
            case Approach():
                return self._approach(factor)

    def _of_pose(self, function: Callable[[F64, F64, Arm], F64]) -> F64:
        pose = self._states.q, self._constants, self._arm
        return self._once(function.__name__, lambda: function(*pose))

    def _temperature(self, factor: Temperature) -> F64:
        value = self._delayed(factor.weights, factor.lag_s)
        if factor.zone_c is not None:
            low, high = factor.zone_c
            return (np.clip(value, low, high) - low) ** factor.order
        reference = self._reference_c if factor.reference_c is None else factor.reference_c
        return (value - reference) ** factor.order

    def _delayed(self, weights: dict[str, float], lag_s: float) -> F64:
        """Σ weight·T, delayed; a sensor without weight may be missing."""
        column = {name: s for s, name in enumerate(self._arm.sensors)}
        value = np.zeros(self._states.n)
        for name, weight in weights.items():
            if weight != 0:
                value += weight * self._states.temperature_c[:, column[name]]
        if lag_s == 0:
            return value
        name = delay_name(weights, lag_s)
        return self._once(name, lambda: self._delay(name, value, self._states.time_s, lag_s))

    def _by_series(self, _: str, value: F64, time_s: F64, lag_s: float) -> F64:
        return lagged(time_s, value[:, None], self._states.series, lag_s)[:, 0]

    def _approach(self, factor: Approach) -> F64:
        approach = np.nan_to_num(self._states.approach)
        if factor.frame == "base":
            return approach[:, AXES.index(factor.axis)]
        last = self._once("rotation", lambda: forward(self._states.q, self._constants)[1])
        component: F64 = np.einsum("ni,ni->n", approach, last[:, :, AXES.index(factor.axis)])
        return component

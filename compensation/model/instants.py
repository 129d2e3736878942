"""The instants at which factors are evaluated; each quantity is computed once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.gravity import (
    compute_gravity_directions,
    compute_gravity_moments,
    compute_gravity_torques,
)
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.state import States, apply_lag

#: (name by `name_delay`, temperature (n,), time (n,) s, lag s) → the temperature delayed (n,)
Delay = Callable[[str, F64, F64, float], F64]


def name_delay(weights: dict[str, float], lag_s: float) -> str:
    """Return a name that is unique to a delayed mean of temperatures."""
    return f"{weights} {lag_s}"


class Instants:
    """States of an arm, with gravity and pose derived from them; *constants* (P,) pose it.

    Lags are followed within each series of the states, unless a *delay* is given.
    """

    def __init__(
        self,
        states: States,
        arm: Arm,
        reference_c: float,
        constants: F64,
        delay: Delay | None = None,
    ) -> None:
        self.reference_c = reference_c
        self._states = states
        # Not a bound method of this object: that would keep it, and a piece of a file with it,
        # until the next garbage collection.
        self._delay = delay
        self._arm = arm
        self._constants = constants
        self._means: dict[str, F64] = {}

    @property
    def q(self) -> F64:
        """The joint angles (n, N) in rad."""
        return self._states.q

    @property
    def time_s(self) -> F64:
        """The times (n,) in Unix seconds."""
        return self._states.time_s

    @cached_property
    def rate(self) -> F64:
        """The joint rates (n, N) in rad/s, 0 where missing."""
        return np.nan_to_num(self._states.rate)

    @cached_property
    def approach(self) -> F64:
        """The direction of approach (n, 3), a unit vector in the base frame, 0 where missing."""
        return np.nan_to_num(self._states.approach)

    @cached_property
    def approach_of_tip(self) -> F64:
        """The direction of approach (n, 3) in the last frame."""
        last = compute_pose(self.q, self._constants)[1]
        turned: F64 = np.einsum("ni,nij->nj", self.approach, last)
        return turned

    @cached_property
    def gravity_torques(self) -> F64:
        """The torques of gravity (n, N) in Nm."""
        return compute_gravity_torques(self.q, self._constants, self._arm)

    @cached_property
    def gravity_directions(self) -> F64:
        """The directions of gravity (n, N, 3), unit vectors."""
        return compute_gravity_directions(self.q, self._constants, self._arm)

    @cached_property
    def gravity_moments(self) -> F64:
        """The moments of gravity (n, N, 3) in Nm."""
        return compute_gravity_moments(self.q, self._constants, self._arm)

    def mean_c(self, weights: dict[str, float], lag_s: float) -> F64:
        """Return Σ weight·T (n,), delayed; a sensor without weight may be missing."""
        name = name_delay(weights, lag_s)
        if name not in self._means:
            value = np.zeros(self._states.n)
            for sensor, weight in weights.items():
                if weight != 0:
                    column = self._arm.sensors.index(sensor)
                    value += weight * self._states.temperature_c[:, column]
            if lag_s != 0:
                delay = self._delay or self._by_series
                value = delay(name, value, self.time_s, lag_s)
            self._means[name] = value
        return self._means[name]

    def _by_series(self, _: str, value: F64, time_s: F64, lag_s: float) -> F64:
        return apply_lag(time_s, value[:, None], self._states.series, lag_s)[:, 0]

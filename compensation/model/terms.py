"""The one idea: parameter = constant + Σ coefficient × basis function of the arm's state.

A `Term` is one such product and is what a calibration file stores. Its basis is a product of
factors, each a function of one thing the daemon knows at an instant. Factors of temperature and
time alone are *slow*: the kernel folds them when a temperature arrives. The others are *pose*
factors, paid for per sample.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from armd.schema import Strict

JointNumber = Annotated[int, Field(ge=1, le=9)]
#: Seconds since 1970, UTC; up to the year 9999, after which nobody writes dates.
UnixSeconds = Annotated[float, Field(ge=0, le=253402300799)]
Weights = Annotated[dict[str, float], Field(min_length=1)]


class Temperature(Strict):
    """(Σ weight·T_sensor − reference)^order, of the temperatures delayed by a first-order lag.

    `reference_c` None: the calibration's reference temperature. With `zone_c` = (low, high) in °C
    the factor is the paper's temperature zone, (clip(Σ weight·T, low, high) − low)^order, so that
    a sum over adjacent zones is a continuous piecewise polynomial; the reference plays no part.
    """

    kind: Literal["temperature"] = "temperature"
    weights: Weights
    order: Annotated[int, Field(ge=1, le=4)] = 1
    lag_s: Annotated[float, Field(ge=0)] = 0.0
    reference_c: float | None = None
    zone_c: tuple[float, float] | None = None


class TemperatureRate(Strict):
    """d/dt of Σ weight·T_sensor in K/s, smoothed by a first-order lag of `smoothing_s`."""

    kind: Literal["temperature_rate"] = "temperature_rate"
    weights: Weights
    smoothing_s: Annotated[float, Field(gt=0)] = 60.0


class Period(Strict):
    """From `since_unix_s` to `until_unix_s` a term that follows time was identified: nobody knows
    how it goes on. None: no end yet (while it is being identified; a calibration that was loaded
    always has one).
    """

    since_unix_s: UnixSeconds
    until_unix_s: UnixSeconds | None = None

    @model_validator(mode="after")
    def _in_order(self) -> Period:
        if self.until_unix_s is not None and self.until_unix_s < self.since_unix_s:
            raise ValueError(f"until_unix_s from {self.since_unix_s} on, not {self.until_unix_s}")
        return self


class Time(Period):
    """((t − since) / 3600 s)^power: hours since an instant (Unix seconds).

    Outside its period the factor holds the value it had at the nearer end.
    """

    kind: Literal["time"] = "time"
    power: Annotated[int, Field(ge=1, le=3)] = 1


class Relaxation(Period):
    """1 − exp(−(t − since) / time constant); outside its period it holds, as `Time` does."""

    kind: Literal["relaxation"] = "relaxation"
    time_constant_s: Annotated[float, Field(gt=0)]


class Daily(Period):
    """sin or cos of the turn of the day since an instant; days go on outside the period, too."""

    kind: Literal["daily_sin", "daily_cos"]


class After(Strict):
    """1 from an instant (Unix seconds) on, 0 before."""

    kind: Literal["after"] = "after"
    instant_unix_s: UnixSeconds


class Harmonic(Strict):
    """sin(order·q) or cos(order·q) of a joint's angle (as read: before its θ offset)."""

    kind: Literal["sin", "cos"]
    joint: JointNumber
    order: Annotated[int, Field(ge=1, le=64)] = 1


class Angle(Strict):
    """q^power of a joint's angle in rad, as read."""

    kind: Literal["angle"] = "angle"
    joint: JointNumber
    power: Annotated[int, Field(ge=1, le=4)] = 1


class Curve(Strict):
    """A stable curve over the turn: periodic cubic spline through equidistant values."""

    kind: Literal["curve"] = "curve"
    joint: JointNumber
    values: Annotated[list[float], Field(min_length=4, max_length=512)]


class GravityTorque(Strict):
    """Gravity torque about a joint's axis in Nm, from the masses of arm.toml and the pose."""

    kind: Literal["gravity_torque"] = "gravity_torque"
    joint: JointNumber


class GravityDirection(Strict):
    """Component of the unit gravity vector along an axis of a joint's outgoing link frame."""

    kind: Literal["gravity_direction"] = "gravity_direction"
    link: JointNumber
    axis: Literal["x", "y", "z"]


class GravityMoment(Strict):
    """Gravity moment in Nm of everything beyond a link, about an axis of its outgoing frame.

    About the origin of that frame (the link's end); zero for the last link, which carries nothing.
    """

    kind: Literal["gravity_moment"] = "gravity_moment"
    link: JointNumber
    axis: Literal["x", "y", "z"]


class Side(Strict):
    """Side of approach: the sign of the joint's last motion (−1, 0 unknown, +1)."""

    kind: Literal["side"] = "side"
    joint: JointNumber


class Rate(Strict):
    """Joint rate in rad/s."""

    kind: Literal["rate"] = "rate"
    joint: JointNumber


class Approach(Strict):
    """Component of the unit approach vector: base frame ("base") or last frame ("tip")."""

    kind: Literal["approach"] = "approach"
    axis: Literal["x", "y", "z"]
    frame: Literal["base", "tip"] = "base"


Factor = Annotated[
    Temperature
    | TemperatureRate
    | Time
    | Relaxation
    | Daily
    | After
    | Harmonic
    | Angle
    | Curve
    | GravityTorque
    | GravityDirection
    | GravityMoment
    | Side
    | Rate
    | Approach,
    Field(discriminator="kind"),
]

SlowFactor = Temperature | TemperatureRate | Time | Relaxation | Daily | After
SLOW_FACTORS = (Temperature, TemperatureRate, Period, After)
#: What depends on the date.
DATED = (Period, After)


class Term(Strict):
    """parameter += coefficient × Π basis; coefficient in the parameter's unit per basis unit."""

    parameter: str
    basis: list[Factor] = Field(default_factory=list)
    coefficient: float = 0.0
    standard_uncertainty: Annotated[float, Field(ge=0)] | None = None
    effect: str | None = None  # the effect it belongs to, e.g. "encoder_eccentricity joint 3"

    @property
    def slow(self) -> bool:
        """True if no factor depends on the pose: folded at the rate of the temperatures."""
        return all(isinstance(factor, SLOW_FACTORS) for factor in self.basis)

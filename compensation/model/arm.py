"""The content of `arm.toml`: the nominal arm, before any measurement."""

from __future__ import annotations

import math
import re
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from armd.arrays import F64
from armd.compensation.model.parameters import MOST_JOINTS, ParameterLayout
from armd.files.schema import Strict, load_toml
from armd.terminal.suggest import format_names

Vector3 = Annotated[tuple[float, float, float], Field(description="three numbers")]
#: No arm is longer than 100 m, and no angle of it more than ten turns.
Millimetres = Annotated[float, Field(ge=-1e5, le=1e5)]
Degrees = Annotated[float, Field(ge=-3600, le=3600)]
Celsius = Annotated[float, Field(ge=-273.15, le=1000)]
Offset = Annotated[tuple[Millimetres, Millimetres, Millimetres], Field(description="x, y, z")]


#: Columns of readings that do not belong to a sensor.
TAKEN = re.compile(
    r"time_s|placement|target|artefact_c|[qw](?:[1-9]|1\d|20)|approach_[xyz]|[xyz]_mm"
)
#: Weights such as thirds with two digits still sum to 1.
WEIGHTS_OFF = 0.011
#: Consecutive axes closer to parallel than this need Hayati's β.
PARALLEL_DEG = 5.0


_layout = cache(ParameterLayout)  # cached, because a layout keeps the names that it has looked up


class TemperatureSensor(Strict):
    name: Annotated[str, Field(min_length=1)]


class Joint(Strict):
    """One row A = Rz(θ+θ0)·Tz(d)·Tx(a)·Rx(α)·Ry(β)."""

    theta_deg: Degrees = 0.0
    d_mm: Millimetres = 0.0
    a_mm: Millimetres = 0.0
    alpha_deg: Degrees = 0.0
    beta_deg: Degrees = 0.0
    counts_per_turn: Annotated[int, Field(gt=0, le=1 << 32)] | None = None
    direction: Literal[1, -1] = 1
    min_deg: Degrees | None = None
    max_deg: Degrees | None = None
    temperature: str | dict[str, float] | None = None
    mass_kg: Annotated[float, Field(ge=0, le=1e4)] | None = None
    centre_of_mass_mm: Offset | None = None

    @property
    def weights(self) -> dict[str, float]:
        """The weight of each sensor; empty for a joint that stays at the reference temperature."""
        if self.temperature is None:
            return {}
        return {self.temperature: 1.0} if isinstance(self.temperature, str) else self.temperature


class Tip(Strict):
    offset_mm: Offset = (0.0, 0.0, 0.0)
    radius_mm: Annotated[float, Field(ge=0, le=1e4)] = 0.0


class Arm(Strict):
    schema_: Literal["armd.arm/1"] = Field(alias="schema")
    serial_number: Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[!-~]+$")]
    reference_temperature_c: Celsius = 20.0
    gravity: Vector3 = (0.0, 0.0, -1.0)
    temperature_sensor: list[TemperatureSensor] = Field(default_factory=list, max_length=16)
    joint: Annotated[list[Joint], Field(min_length=3, max_length=MOST_JOINTS)]
    tip: Tip = Tip()

    @model_validator(mode="after")
    def _consistent(self) -> Arm:
        sensors = self.sensors
        if len(set(sensors)) != len(sensors):
            raise ValueError("sensor names that differ from each other")
        for name in filter(TAKEN.fullmatch, sensors):
            raise ValueError(f"sensor names that are no other column's of readings, not {name!r}")
        for k, joint in enumerate(self.joint, 1):
            for name in joint.weights:
                if name not in sensors:
                    raise ValueError(
                        f"joint[{k}].temperature to name one of the sensors"
                        f" ({format_names(sensors) or 'none'}), not {name!r}"
                    )
            if joint.temperature is not None and not joint.weights:
                raise ValueError(f"joint[{k}].temperature with at least one weight")
            weight_sum = sum(joint.weights.values())
            if joint.weights and abs(weight_sum - 1.0) > WEIGHTS_OFF:
                raise ValueError(
                    f"joint[{k}].temperature with weights that sum to 1, not {weight_sum:g}"
                )
            low, high = joint.min_deg, joint.max_deg
            if low is not None and high is not None and low >= high:
                raise ValueError(f"joint[{k}].min_deg below max_deg, not {low} and {high}")
        if not math.isclose(float(np.linalg.norm(self.gravity)), 1.0, abs_tol=1e-6):
            raise ValueError(f"gravity of length 1, not {list(self.gravity)}")
        return self

    @property
    def n_joints(self) -> int:
        return len(self.joint)

    @property
    def layout(self) -> ParameterLayout:
        """The layout of its parameters."""
        return _layout(self.n_joints)

    @property
    def sensors(self) -> list[str]:
        """The sensor names in the order of the wire's channels."""
        return [sensor.name for sensor in self.temperature_sensor]

    @property
    def used_sensors(self) -> list[str]:
        """The sensors with a non-zero weight in a joint's temperature; in the same order."""
        return [s for s in self.sensors if any(joint.weights.get(s) for joint in self.joint)]

    @property
    def used_columns(self) -> list[int]:
        """The indices of the used sensors among all sensors."""
        return [self.sensors.index(name) for name in self.used_sensors]

    @property
    def reach_mm(self) -> float:
        """The upper limit of a joint's lever to the tip, in the nominal geometry."""
        links = sum(math.hypot(joint.a_mm, joint.d_mm) for joint in self.joint)
        return links + math.hypot(*self.tip.offset_mm)

    @property
    def limits_rad(self) -> tuple[F64, F64]:
        """The lowest and highest angles (N,) of the joints, ∓inf where arm.toml has none."""
        low = [-math.inf if joint.min_deg is None else joint.min_deg for joint in self.joint]
        high = [math.inf if joint.max_deg is None else joint.max_deg for joint in self.joint]
        return np.radians(low), np.radians(high)

    @property
    def range_rad(self) -> tuple[F64, F64]:
        """The lowest and highest angles (N,); ∓π where arm.toml has none."""
        low, high = self.limits_rad
        return np.where(np.isinf(low), -np.pi, low), np.where(np.isinf(high), np.pi, high)

    def nominal(self) -> F64:
        """Return the nominal parameter vector (5 N + 9,), mm and rad, ordered as `parameters`."""
        layout = self.layout
        values = np.zeros(layout.count)
        for k, joint in enumerate(self.joint, 1):
            values[layout.joint(k)] = (
                math.radians(joint.theta_deg),
                joint.d_mm,
                joint.a_mm,
                math.radians(joint.alpha_deg),
                math.radians(joint.beta_deg),
            )
        values[layout.tip] = self.tip.offset_mm
        return values


def load_arm(path: str | Path) -> Arm:
    """Read and check an arm.toml; raises `BadInput` naming file, key, found and expected."""
    return load_toml(path, Arm)

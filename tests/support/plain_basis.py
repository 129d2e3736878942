"""Each factor of a basis by its definition, from a scene's columns: truth for what causes add.

A kind that is not here makes `value` fail: whoever adds a basis says here what it is worth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import lsim

from armd.compensation.model.arm import Arm
from support.plain_kinematics import frames, tip_pose

GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True)
class Scene:
    """What was known at n readings, in the order of time; each run's at even steps."""

    arm: Arm  # its masses and their centres given
    constants: np.ndarray  # (P,)
    reference_c: float
    q: np.ndarray  # (n, N)
    rate: np.ndarray  # (n, N)
    temperature_c: np.ndarray  # (n, S)
    time_s: np.ndarray  # (n,)
    approach: np.ndarray  # (n, 3)
    series: np.ndarray  # (n,) number of the run

    @property
    def parameters(self) -> np.ndarray:
        """(n, P) the constants at every reading."""
        return np.tile(self.constants, (len(self.q), 1))

    @property
    def frames(self) -> np.ndarray:
        return frames(self.q, self.parameters)

    @property
    def down(self) -> np.ndarray:
        return np.array(self.arm.gravity)

    def mean_c(self, weights: dict[str, float], lag_s: float = 0.0) -> np.ndarray:
        """A weighted mean, delayed by a system of first order that begins settled."""
        mean = sum(w * self.temperature_c[:, self.arm.sensors.index(n)] for n, w in weights.items())
        found = np.array(mean)
        for run in np.unique(self.series) if lag_s else []:
            rows = np.flatnonzero(self.series == run)
            first = found[rows[0]]
            since_s = self.time_s[rows] - self.time_s[rows[0]]
            system = ([1.0], [lag_s, 1.0])
            found[rows] = first + lsim(system, found[rows] - first, since_s)[1]
        return found


def value(factor: Any, scene: Scene) -> np.ndarray:
    """(n,) what a factor of any kind is worth."""
    return FACTORS[factor.kind](factor, scene)


def _temperature(factor: Any, scene: Scene) -> np.ndarray:
    assert factor.zone_c is None, "no cause has a zone"
    reference = scene.reference_c if factor.reference_c is None else factor.reference_c
    return (scene.mean_c(factor.weights, factor.lag_s) - reference) ** factor.order


def _temperature_rate(factor: Any, scene: Scene) -> np.ndarray:
    behind = scene.mean_c(factor.weights, factor.smoothing_s)
    return (scene.mean_c(factor.weights) - behind) / factor.smoothing_s


def _since_s(factor: Any, scene: Scene) -> np.ndarray:
    until = np.inf if factor.until_unix_s is None else factor.until_unix_s
    return np.clip(scene.time_s, factor.since_unix_s, until) - factor.since_unix_s


def _torque(factor: Any, scene: Scene) -> np.ndarray:
    """How the height of all masses falls as the joint turns."""

    def energy_j(q: np.ndarray) -> np.ndarray:
        at = frames(q, scene.parameters)
        found = np.zeros(len(q))
        for k, joint in enumerate(scene.arm.joint, 1):
            centre = at[:, k] @ [*joint.centre_of_mass_mm, 1.0]
            found -= joint.mass_kg * GRAVITY_M_S2 * (centre[:, :3] @ scene.down) / 1000
        return found

    step = np.zeros(scene.q.shape[1])
    step[factor.joint - 1] = 1e-5
    return -(energy_j(scene.q + step) - energy_j(scene.q - step)) / 2e-5


def _in_link(vectors: np.ndarray, factor: Any, scene: Scene) -> np.ndarray:
    """The component of base-frame vectors (n, 3) along an axis of a link's frame."""
    axis = scene.frames[:, factor.link, :3, "xyz".index(factor.axis)]
    return (axis * vectors).sum(axis=1)


def _moment(factor: Any, scene: Scene) -> np.ndarray:
    at = scene.frames
    moment = np.zeros((len(scene.q), 3))
    for k, joint in enumerate(scene.arm.joint, 1):
        if k > factor.link:
            centre = (at[:, k] @ [*joint.centre_of_mass_mm, 1.0])[:, :3]
            lever_m = (centre - at[:, factor.link, :3, 3]) / 1000
            moment += np.cross(lever_m, joint.mass_kg * GRAVITY_M_S2 * scene.down)
    return _in_link(moment, factor, scene)


def _direction(factor: Any, scene: Scene) -> np.ndarray:
    return _in_link(np.tile(scene.down, (len(scene.q), 1)), factor, scene)


def _approach(factor: Any, scene: Scene) -> np.ndarray:
    axis = "xyz".index(factor.axis)
    if factor.frame == "base":
        return scene.approach[:, axis]
    return (tip_pose(scene.q, scene.parameters)[:, :3, axis] * scene.approach).sum(axis=1)


FACTORS: dict[str, Callable[[Any, Scene], np.ndarray]] = {
    "temperature": _temperature,
    "temperature_rate": _temperature_rate,
    "time": lambda f, s: (_since_s(f, s) / 3600) ** f.power,
    "relaxation": lambda f, s: 1 - np.exp(-_since_s(f, s) / f.time_constant_s),
    "daily_sin": lambda f, s: np.sin(2 * np.pi * _since_s(f, s) / 86400),
    "daily_cos": lambda f, s: np.cos(2 * np.pi * _since_s(f, s) / 86400),
    "after": lambda f, s: 1.0 * (s.time_s >= f.instant_unix_s),
    "sin": lambda f, s: np.sin(f.order * s.q[:, f.joint - 1]),
    "cos": lambda f, s: np.cos(f.order * s.q[:, f.joint - 1]),
    "angle": lambda f, s: s.q[:, f.joint - 1] ** f.power,
    "side": lambda f, s: np.sign(s.rate[:, f.joint - 1]),
    "rate": lambda f, s: s.rate[:, f.joint - 1],
    "approach": _approach,
    "gravity_torque": _torque,
    "gravity_direction": _direction,
    "gravity_moment": _moment,
}

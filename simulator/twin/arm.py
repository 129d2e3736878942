"""The twin in time: its sensors follow the room, and its joints have a direction of motion."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from armd.arrays import F64
from armd.errors import BadInput
from armd.simulator.live.electronics import ArmParts
from armd.simulator.live.operator import Comfort, Hand
from armd.simulator.live.physics import Block, Heat, WarmUp, generate_steps, group_in_blocks
from armd.simulator.truth.effects.effect import Conditions, Masses, Posture
from armd.simulator.twin.chain import Frames
from armd.simulator.twin.factors import Slow
from armd.simulator.twin.files import ArmData
from armd.simulator.twin.model import FirstOrderLag, TwinModel
from armd.simulator.twin.noise import KNOT_S, FoundNoise

#: A tiny rate that keeps a joint's side of approach while it rests.
NO_RATE_RAD_S = 1e-12


class LiveMeans:
    """Present mean temperatures of the sensors; lags are followed from call to call."""

    def __init__(self, sensors: tuple[str, ...]) -> None:
        self._sensors = sensors
        self._lags: dict[str, FirstOrderLag] = {}
        self._unix_s = 0.0
        self._celsius: F64 = np.zeros(len(sensors))

    def feel(self, unix_s: float, celsius: F64) -> None:
        """Set the temperatures of the sensors (S,) from now on."""
        self._unix_s, self._celsius = unix_s, celsius

    def mean_c(self, weights: Mapping[str, float], lag_s: float) -> F64:
        mean = sum(w * float(self._celsius[self._sensors.index(s)]) for s, w in weights.items())
        if lag_s:
            lag = self._lags.setdefault(f"{sorted(weights.items())} {lag_s}", FirstOrderLag(lag_s))
            mean = lag.delay(self._unix_s, mean)
        return np.array([mean])


class BaseDrift:
    """A drifting base: an endless random walk from knot to knot; ask in order of time."""

    def __init__(self, step_mm: float, seed: int) -> None:
        self._step_mm = step_mm
        self._rng = np.random.default_rng([seed, 0xD21F])
        self._knots = np.zeros((1, 3))

    def shift_mm_at(self, time_s: F64) -> F64:
        """Return the shift (n, 3) mm at times (n,) s."""
        if not self._step_mm:
            return np.zeros((len(time_s), 3))
        while KNOT_S * (len(self._knots) - 1) < time_s.max(initial=0.0):
            step = self._step_mm * self._rng.normal(size=(1, 3))
            self._knots = np.concatenate([self._knots, self._knots[-1:] + step])
        at_s = KNOT_S * np.arange(len(self._knots))
        return np.stack([np.interp(time_s, at_s, knots) for knots in self._knots.T], axis=1)


class TwinArm:
    """The twin as `truth.arm.Movable`: its angles are those of the encoders.

    Temperatures and time are constant between two calls of `feel`. `tip`, by which a hand plans a
    posture, uses the sides from which the joints last came.
    """

    def __init__(self, model: TwinModel, noise: FoundNoise, seed: int) -> None:
        self.model = model
        self._noise, self._seed = noise, seed
        self._means = LiveMeans(model.arm.sensors)
        self._drift = BaseDrift(noise.drift_mm, seed)
        self._rate = np.zeros(self.n_joints)  # rates of the last motion
        self._approach = np.full(3, np.nan)
        self.feel(time.time(), np.full(len(model.arm.sensors), model.calibration.reference_c))
        self._means = LiveMeans(model.arm.sensors)  # lags settle at the first temperatures

    @property
    def n_joints(self) -> int:
        return self.model.arm.n_joints

    @property
    def is_rigid(self) -> bool:
        return not self.model.calibration.terms and not self._noise.drift_mm

    def as_rigid(self) -> TwinArm:
        """Return this arm without terms."""
        bare = TwinModel(self.model.arm, replace(self.model.calibration, terms=()))
        return TwinArm(bare, FoundNoise(), self._seed)

    def feel(self, unix_s: float, celsius: F64) -> None:
        """Set the present instant, and the temperatures of the sensors (S,)."""
        self._means.feel(unix_s, celsius)
        calibration = self.model.calibration
        self._amounts = self.model.slow_amounts(
            Slow(
                self._means,
                np.array([unix_s]),
                calibration.reference_c,
                calibration.created_unix_s,
            )
        )[0]

    def encoder_angles(self, phi: F64, conditions: Conditions) -> F64:
        return phi

    def tip(self, phi: F64, conditions: Conditions) -> F64:
        rate = np.where(conditions.rate == 0, NO_RATE_RAD_S * np.sign(self._rate), conditions.rate)
        approach = np.broadcast_to(self._approach, (len(phi), 3))
        return self._stand(phi, rate, approach).tip + self._drift.shift_mm_at(conditions.time_s)

    def posture(self, phi: F64, conditions: Conditions) -> Posture:
        frames = self._stand(phi, np.zeros_like(phi), np.full((len(phi), 3), np.nan))
        weights = self.model.arm.weights
        masses = Masses(weights.kg, weights.centre_mm)
        turning = frames.rotation[1:]
        return Posture(phi, frames.origin, frames.rotation, turning, frames.tip, masses)

    def move(self, phi: F64, rate: F64, time_s: F64) -> F64:
        """Return the true tip (n, 3) mm as the joints go through *phi* (n, N) rad, in order of
        time.

        A resting joint keeps the side from which it came, a resting tip its direction of travel.
        """
        sided, approach = np.empty_like(rate), np.empty((len(rate), 3))
        moving = self.model.direction_of_motion(phi, rate)
        for i in range(len(rate)):
            turning = rate[i] != 0
            self._rate = np.where(turning, rate[i], self._rate)
            sided[i] = np.where(turning, rate[i], NO_RATE_RAD_S * np.sign(self._rate))
            if np.isfinite(moving[i, 0]):
                self._approach = moving[i]
            approach[i] = self._approach
        return self._stand(phi, sided, approach).tip + self._drift.shift_mm_at(time_s)

    def _stand(self, phi: F64, rate: F64, approach: F64) -> Frames:
        return self.model.stand(phi, rate, approach, self._amounts)


class TwinHeat(Heat):
    """The heat of the demo arm's links, as the twin's sensors measure it."""

    def __init__(self, twin: TwinArm, ambient_c: float, warm_up: WarmUp | None) -> None:
        super().__init__(ambient_c, warm_up, twin.n_joints)
        self._twin = twin
        self._began_unix_s = time.time()

    def advance_to(self, time_s: float) -> tuple[F64, F64]:
        """Return the temperatures of the links' sensors (N,), and those of arm.toml (S,)."""
        _, by_link = super().advance_to(time_s)
        sensor_c = by_link[list(self._twin.model.arm.joint_of_sensor)]
        self._twin.feel(self._began_unix_s + time_s, sensor_c)
        return by_link, sensor_c


def generate_twin_blocks(
    twin: TwinArm, hand: Hand, rate_hz: int, heat: TwinHeat
) -> Iterator[Block]:
    """Generate the twin's course from time 0 on, as `physics.generate_blocks` does."""
    life = generate_steps(hand, heat, rate_hz)
    return group_in_blocks((step, twin.move(step.phi, step.rate, step.time_s)) for step in life)


def find_comfort(arm: ArmData) -> Comfort:
    """Return postures about the middle of each joint's range, of ±half a turn without limits."""
    low = np.where(np.isinf(arm.limits_rad[0]), -np.pi, arm.limits_rad[0])
    high = np.where(np.isinf(arm.limits_rad[1]), np.pi, arm.limits_rad[1])
    return Comfort((low + high) / 2, np.minimum((high - low) / 5, np.pi / 4), low, high)


def make_parts(arm: ArmData, noise: FoundNoise, wire: str) -> ArmParts:
    """Make its encoders for a *wire*, "serial" or "can".

    Raises `BadInput` for counts that the wire cannot carry.
    """
    turns = []
    for k, turn in enumerate(arm.counts_per_turn, 1):
        location = f"joint[{k}].counts_per_turn"
        if turn is None:
            raise BadInput(
                "arm.toml", location, "nothing", "counts per turn: a wire carries counts"
            )
        if wire == "serial" and turn & (turn - 1):
            raise BadInput("arm.toml", location, str(turn), "a power of two: counts wrap at 2^bits")
        turns.append(turn)
    return ArmParts(tuple(turns), arm.direction, noise.encoder_rad, 0.0)

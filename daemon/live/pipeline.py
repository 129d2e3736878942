"""Samples in, points out: no port, no clock, no network.

Every decision rests on the samples, the temperatures and their own monotonic_ns, so a replay of
the same stream gives bit-identical points however it was cut into batches.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Hashable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armd import POINT, Flag
from armd.arrays import F64, I64
from armd.compensation.kernel.kernel import uncorrected
from armd.compensation.kernel.memory import FlatModel
from armd.compensation.kernel.model import Model
from armd.compensation.kernel.points import fill
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import LoadedCalibration
from armd.compiled.jit import jit, settled
from armd.compiled.library import kind
from armd.daemon.config import Limits
from armd.daemon.live.flags import Flagger, finish
from armd.daemon.live.motion import Motion, follow
from armd.daemon.live.temperature_age import TemperatureWatch
from armd.drivers.sample import SampleArray, Temperatures

PointArray = npt.NDArray[np.void]

#: Temperatures are remembered for this long, so coarsely: link time constants are many minutes.
MEMORY_S = 7200.0
MEMORY_STEP_S = 10.0
#: Samples of a batch for which there is room at first.
ROOM = 64
#: No joint goes so far beyond its end stop: an encoder that says so is broken, or not this joint's.
BEYOND_STOP_DEG = 10.0
#: Points that an array is made for at once.
POINTS_MADE = 256
#: A model that depends on the date is brought up to it this often, if no temperature does it.
DATE_STEP_NS = 1_000_000_000


class Joints(NamedTuple):
    """What joints and tip did at n samples, as `armd.daemon.live.motion.follow` tells it.

    The arrays have room for more (m ≥ n rows) and are overwritten by the next samples.
    """

    q: F64  # (m, N) rad, as read (before θ offset)
    rate: F64  # (m, N) rad/s, its sign the side of approach; NaN unknown
    approach: F64  # (m, 3) unit vectors, base frame; NaN unknown
    still_since_ns: I64  # (m,) monotonic instant since which the tip was still


class Prepared(NamedTuple):
    """What another calibration needs, made ready beside the stream."""

    arm: Arm
    calibration: LoadedCalibration | None
    model: Model
    past_ns: int  # stamp of the last temperatures of the past that its lags know


class Pipeline:
    """The arithmetic of one arm between its driver and its publisher."""

    def __init__(self, arm: Arm, calibration: LoadedCalibration | None, limits: Limits) -> None:
        turns = [joint.counts_per_turn or 1 for joint in arm.joint]
        self._encoders = _encoders(arm, turns)
        self._motion = Motion(turns, arm.reach_mm)
        self._flagger = Flagger(arm)
        self._make_room(ROOM, len(turns))
        #: `_correct`, settled for samples of this kind and the model in use; all else is made here.
        self._settled: Callable[..., None] | None = None
        self._kind: Hashable = None
        self._points, self._used = np.zeros(0, POINT), 0
        self.temperature = TemperatureWatch(arm, limits)
        self._stamp_ns = 0  # of the last temperatures, or of a later sample where the date counts
        self._past: deque[tuple[F64, int]] = deque(maxlen=round(MEMORY_S / MEMORY_STEP_S))
        self._begun = False
        self.use(self.prepare(arm, calibration))

    def prepare(self, arm: Arm, calibration: LoadedCalibration | None) -> Prepared:
        """Everything that takes long of `use`; in any thread, while samples are corrected."""
        model = Model(arm, calibration)
        past_ns = 0
        for celsius, past_ns in tuple(self._past):  # a term that lags remembers what it never saw
            model.follow(celsius, past_ns * 1e-9)
        return Prepared(arm, calibration, model, past_ns)

    def use(self, prepared: Prepared) -> None:
        """Correct with this calibration (None: nominal geometry) from the next sample on."""
        arm, calibration, self._model, past_ns = prepared
        self._settled = None
        self._identity = 0 if calibration is None else calibration.identity
        self._own_flags = Flag.NOT_CALIBRATED if calibration is None else Flag(0)
        self.temperature.use(arm, None if calibration is None else calibration.content)
        for celsius, stamp_ns in self._past:
            if stamp_ns > past_ns:  # what came while it was prepared
                self._model.follow(celsius, stamp_ns * 1e-9)
        self._fold()

    def take_temperatures(self, reading: Temperatures) -> None:
        """Everything after this reading is corrected with it, unless too many come."""
        if not self.temperature.update(reading.celsius, reading.monotonic_ns, reading.resolution_c):
            return
        self._stamp_ns = reading.stamp_ns
        long_ago = not self._past or self._stamp_ns - self._past[-1][1] >= MEMORY_STEP_S * 1e9
        if self.temperature.has_values and long_ago:
            self._past.append((self.temperature.held_c, self._stamp_ns))
        self._fold()

    def take_beyond_stops(self) -> dict[int, float]:
        """Joints that were invalid since the last call because they read far beyond an end stop,
        with the farthest angle in degrees."""
        encoders = self._encoders
        if not encoders["excess"].any():
            return {}
        beyond = {
            k: math.degrees(encoder["farthest"])
            for k, encoder in enumerate(encoders, 1)
            if encoder["excess"]
        }
        encoders["excess"] = 0.0
        return beyond

    @property
    def outside_period(self) -> tuple[float, float] | None:
        """The period (Unix seconds) in which a term was identified that is held now, outside it."""
        return self._model.outside_period(self._stamp_ns * 1e-9) if self._stamp_ns else None

    def _fold(self) -> None:
        """Whatever changes with the temperatures, or the date, and not with each sample."""
        self._judge()
        if self._stamp_ns or not self._model.dated:  # the first sample tells the date
            self._model.fold(self.temperature.held_c, self._stamp_ns * 1e-9)
        if not self.temperature.has_values:
            self._model.forget()  # lags start with the first measured temperatures

    def _judge(self) -> None:
        watch = self.temperature
        flags = self._own_flags | watch.temperature_flags
        if self.outside_period is not None:
            flags |= Flag.TEMPERATURE_RANGE
        self._flagger.judge_by(flags, watch.stale_after_ns, watch.invalid_after_ns, self._identity)

    def correct(self, samples: SampleArray) -> tuple[PointArray, Joints]:
        """Points (n,) of samples (n,), and what the joints did; the latter until the next call."""
        n = len(samples)
        if not self._begun:
            self._begun = True
            self.temperature.begin(int(samples["monotonic_ns"][0]))
            self._judge()
        joints = self._joints
        if n > len(joints.q):
            joints = self._make_room(2 * n, joints.q.shape[1])
        points = self._new_points(n)
        start = 0
        if self._model.dated:
            for row, stamp_ns in enumerate(samples["stamp_ns"].tolist()):
                if abs(stamp_ns - self._stamp_ns) >= DATE_STEP_NS:
                    if row > start:
                        self._correct(samples, start, row, points)
                    start, self._stamp_ns = row, stamp_ns
                    self._fold()
        self._correct(samples, start, n, points)
        return points, joints

    def _correct(self, samples: SampleArray, start: int, end: int, points: PointArray) -> None:
        joints, tip = self._joints, self._tip
        if end - start < len(samples):  # rarely: slices cost more than the call
            samples, points, tip = samples[start:end], points[start:end], tip[start:]
            q, rate, approach, still_since_ns = joints
            joints = Joints(q[start:], rate[start:], approach[start:], still_since_ns[start:])
        arguments = (
            samples, self._encoders, *joints, tip, self._motion.memory, *self._model.flat,
            *self._model.covariance, self._flagger.memory, points,
        )  # fmt: skip
        if self._settled is None or kind(samples) != self._kind:
            self._settled, self._kind = settled(_correct, *arguments), kind(samples)
        self._settled(*arguments)

    def _new_points(self, n: int) -> PointArray:
        """Zeros (n,) that nobody has yet; made for many at once, which costs as much as for one."""
        end = self._used + n
        if end > len(self._points):
            self._points = np.zeros(max(n, POINTS_MADE), POINT)
            self._used, end = 0, n
        points, self._used = self._points[self._used : end], end
        return points

    def _make_room(self, m: int, n_joints: int) -> Joints:
        """For batches of up to *m* samples."""
        q, rate = np.empty((2, m, n_joints))
        self._joints = Joints(q, rate, np.empty((m, 3)), np.empty(m, np.int64))
        self._tip = np.empty((m, 3))
        return self._joints


@jit
def _correct(
    samples: Any, encoders: Any, q: Any, rate: Any, approach: Any, still_since_ns: Any, tip: Any,
    motion: Any, sizes: Any, numbers: Any, work: Any, factor: Any, rows: Any, floor_mm2: float,
    flags: Any, points: Any,
) -> None:  # fmt: skip
    """From samples (n,) to finished points (n,): the live path's one compiled call, because each
    call from Python costs as much as what it does for one sample, and each argument a tenth."""
    n = len(samples)
    q, rate, approach, still_since_ns = q[:n], rate[:n], approach[:n], still_since_ns[:n]
    flat = FlatModel(sizes, numbers, work)
    _angles(samples, encoders, q)
    uncorrected(q, flat, tip)
    follow(samples, q, tip, motion, rate, approach, still_since_ns)
    fill(q, rate, approach, flat, factor, rows, floor_mm2, points)
    finish(samples, q, still_since_ns, flags, points)


@jit
def _angles(samples: Any, encoders: Any, q: Any) -> None:
    """Angles (n, N) rad; a joint that turns at most once is in the turn of its limits. One that
    cannot be where it says it is becomes invalid."""
    for i in range(len(samples)):
        for k in range(len(encoders)):
            encoder = encoders[k]
            angle = samples[i].count[k] * encoder.radians
            if encoder.one_turn:
                angle -= 2 * math.pi * math.floor((angle - encoder.middle) / (2 * math.pi) + 0.5)
                excess = max(encoder.least - angle, angle - encoder.most)
                if excess > 0.0 and not samples[i].joint_invalid >> k & 1:
                    samples[i].joint_invalid |= 1 << k
                    if excess > encoder.excess:
                        encoder.excess = excess
                        encoder.farthest = angle
            q[i, k] = angle


def _encoders(arm: Arm, counts_per_turn: list[int]) -> npt.NDArray[np.void]:
    """Of each joint: rad per count, the middle of its range, whether that is at most one turn, the
    angles (rad) between which it can be, and by how much it was beyond since that was asked last,
    where at the farthest."""
    numbers = ("radians", "middle", "least", "most", "excess", "farthest")
    encoders = np.zeros(arm.n_joints, [(name, "f8") for name in numbers] + [("one_turn", "?")])
    low = np.array([-180.0 if joint.min_deg is None else joint.min_deg for joint in arm.joint])
    high = np.array([180.0 if joint.max_deg is None else joint.max_deg for joint in arm.joint])
    direction = np.array([joint.direction for joint in arm.joint])
    encoders["radians"] = direction * 2 * math.pi / counts_per_turn
    encoders["middle"] = np.radians((low + high) / 2)
    encoders["one_turn"] = high - low <= 360
    limits = np.array(arm.limits_rad)
    encoders["least"], encoders["most"] = limits + np.radians(
        [[-BEYOND_STOP_DEG], [BEYOND_STOP_DEG]]
    )
    return encoders

"""Convert samples to points, without port, clock and network.

Every decision depends only on the samples, the temperatures and their own monotonic_ns. So a replay
of the same stream gives bit-identical points however it was cut into batches.
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
from armd.compensation.kernel.kernel import compute_uncorrected
from armd.compensation.kernel.memory import FlatModel
from armd.compensation.kernel.model import Model
from armd.compensation.kernel.points import fill
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import LoadedCalibration
from armd.compiled.jit import jit, select_compiled
from armd.compiled.library import describe_kind
from armd.daemon.config import Limits
from armd.daemon.live.flags import Flagger, set_flags
from armd.daemon.live.motion import Motion, follow
from armd.daemon.live.temperature_watch import TemperatureWatch
from armd.drivers.sample import SampleArray, Temperatures

PointArray = npt.NDArray[np.void]

#: Time and step of the stored temperatures; link time constants are many minutes.
MEMORY_S = 7200.0
MEMORY_STEP_S = 10.0
#: Initial limit of samples in a batch.
ROOM = 64
#: No joint goes so far beyond its end stop: such an encoder is broken, or of another joint.
BEYOND_STOP_DEG = 10.0
#: Points of an array that is allocated at once.
POINTS_MADE = 256
#: Period after which a model that depends on the date is updated, if no temperature does it.
DATE_STEP_NS = 1_000_000_000


class Joints(NamedTuple):
    """Motion of joints and tip at n samples, from `armd.daemon.live.motion.follow`.

    The arrays may have more rows (m ≥ n) and are overwritten by the next samples.
    """

    q: F64  # (m, N) rad, as read (before θ offset)
    rate: F64  # (m, N) rad/s, its sign the side of approach; NaN unknown
    approach: F64  # (m, 3) unit vectors, base frame; NaN unknown
    still_since_ns: I64  # (m,) monotonic instant since which the tip was still


class Prepared(NamedTuple):
    """Another calibration, prepared beside the stream."""

    arm: Arm
    calibration: LoadedCalibration | None
    model: Model
    past_ns: int  # stamp of the last past temperatures that its lags include


class Pipeline:
    """The computation of one arm between its driver and its publisher."""

    def __init__(self, arm: Arm, calibration: LoadedCalibration | None, limits: Limits) -> None:
        turns = [joint.counts_per_turn or 1 for joint in arm.joint]
        motion, self._flagger = Motion(turns, arm.reach_mm), Flagger(arm)
        #: All memory between samples, in one record.
        self._memory = _one_record(
            encoders=_encoders(arm, turns), motion=motion.memory, flags=self._flagger.memory
        )
        self._flagger.memory = self._memory["flags"]
        self._room = ROOM
        #: `_correct`, compiled for samples of this kind and the model in use.
        self._compiled_correct: Callable[..., None] | None = None
        self._kind: Hashable = None
        self._points, self._used = np.zeros(0, POINT), 0
        self.temperature = TemperatureWatch(arm, limits)
        self._stamp_ns = 0  # of the last temperatures, or of a later sample if dated
        self._past: deque[tuple[F64, int]] = deque(maxlen=round(MEMORY_S / MEMORY_STEP_S))
        self._begun = False
        self.use(self.prepare(arm, calibration))

    def prepare(self, arm: Arm, calibration: LoadedCalibration | None) -> Prepared:
        """Do the slow part of `use`, in any thread, while samples are corrected."""
        model = Model(arm, calibration)
        past_ns = 0
        for celsius, past_ns in tuple(self._past):  # gives lagged terms the past temperatures
            model.follow(celsius, past_ns * 1e-9)
        return Prepared(arm, calibration, model, past_ns)

    def use(self, prepared: Prepared) -> None:
        """Correct with this calibration (None: nominal geometry) from the next sample on."""
        arm, calibration, self._model, past_ns = prepared
        self._compiled_correct = None
        self._identity = 0 if calibration is None else calibration.identity
        self._own_flags = Flag.NOT_CALIBRATED if calibration is None else Flag(0)
        self.temperature.use(arm, None if calibration is None else calibration.content)
        for celsius, stamp_ns in self._past:
            if stamp_ns > past_ns:  # arrived during the preparation
                self._model.follow(celsius, stamp_ns * 1e-9)
        self._lay_out()
        self._fold()

    def take_temperatures(self, reading: Temperatures) -> None:
        """Use a reading for all later samples, unless too many readings come."""
        if not self.temperature.update(reading.celsius, reading.monotonic_ns, reading.resolution_c):
            return
        self._stamp_ns = reading.stamp_ns
        long_ago = not self._past or self._stamp_ns - self._past[-1][1] >= MEMORY_STEP_S * 1e9
        if self.temperature.has_values and long_ago:
            self._past.append((self.temperature.held_c, self._stamp_ns))
        self._fold()

    def take_beyond_stops(self) -> dict[int, float]:
        """Return the joints that were invalid since the last call, with an angle in degrees.

        They read far beyond an end stop; the angle is the farthest.
        """
        excess, farthest = (self._memory["encoders"][name][0] for name in ("excess", "farthest"))
        if not excess.any():
            return {}
        beyond = {k + 1: math.degrees(farthest[k]) for k in np.flatnonzero(excess).tolist()}
        excess[:] = 0.0
        return beyond

    @property
    def outside_period(self) -> tuple[float, float] | None:
        """The period (Unix seconds) of a term that is used outside it, or None.

        The term was identified in that period, and its value is held now.
        """
        return self._model.outside_period(self._stamp_ns * 1e-9) if self._stamp_ns else None

    def _fold(self) -> None:
        """Update all that depends on temperatures or the date, and not on each sample."""
        self._judge()
        if self._stamp_ns or not self._model.dated:  # else the first sample gives the date
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
        """Return points (n,) of samples (n,), and the joints' motion.

        The latter is valid until the next call.
        """
        n = len(samples)
        if not self._begun:
            self._begun = True
            self.temperature.begin(int(samples["monotonic_ns"][0]))
            self._judge()
        if n > self._room:
            self._room = 2 * n
            self._lay_out()
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
        return points, self._joints

    def _correct(self, samples: SampleArray, start: int, end: int, points: PointArray) -> None:
        if end - start < len(samples):  # rarely: slices cost more than the call
            samples, points = samples[start:end], points[start:end]
        factor, _, floor_mm2 = self._model.covariance
        arguments = (
            samples, start, self._room, self._memory, self._floats, self._n_numbers, self._ints,
            factor, floor_mm2, points,
        )  # fmt: skip
        if self._compiled_correct is None or describe_kind(samples) != self._kind:
            self._compiled_correct, self._kind = (
                select_compiled(_correct, *arguments),
                describe_kind(samples),
            )
        self._compiled_correct(*arguments)

    def _new_points(self, n: int) -> PointArray:
        """Return zeros (n,) that are not in use; many are allocated at once.

        That costs as much as for one.
        """
        end = self._used + n
        if end > len(self._points):
            self._points = np.zeros(max(n, POINTS_MADE), POINT)
            self._used, end = 0, n
        points, self._used = self._points[self._used : end], end
        return points

    def _lay_out(self) -> None:
        """Lay out the joints' columns and the model in one array of floats and one of integers.

        Each array that is passed to the compiled call costs a tenth of the call's work.
        """
        m, n_joints = self._room, len(self._memory["encoders"]["radians"][0])
        sizes, numbers, work = self._model.flat
        rows = self._model.covariance[1]
        self._floats = np.zeros(2 * m * (n_joints + 3) + numbers.size + work.size)
        self._ints = np.concatenate([np.zeros(m, np.int64), sizes, rows.astype(np.int64)])
        self._n_numbers = numbers.size
        q, rate, approach, _, own_numbers, own_work = _parts(
            self._floats, m, n_joints, numbers.size
        )
        own_numbers[:], own_work[:] = numbers, work
        self._joints = Joints(q, rate, approach, self._ints[:m])
        self._model.flat = FlatModel(sizes, own_numbers, own_work)


def _one_record(**memories: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """Return (1,) with a record (1,) under each name."""
    record = np.zeros(1, [(name, memory.dtype) for name, memory in memories.items()])
    for name, memory in memories.items():
        record[name] = memory
    return record


@jit
def _parts(floats: Any, room: int, n_joints: int, n_numbers: int) -> Any:
    """Return views of *floats*: angles, rates, approaches, tips, numbers and scratch.

    The first four have *room* samples. The model's numbers and its scratch are for one sample.
    """
    m = room * n_joints
    q, rate, rest = floats[:m], floats[m : 2 * m], floats[2 * m :]
    m = 3 * room
    approach, tip, rest = rest[:m], rest[m : 2 * m], rest[2 * m :]
    work = rest[n_numbers:]
    return (
        q.reshape(room, n_joints), rate.reshape(room, n_joints), approach.reshape(room, 3),
        tip.reshape(room, 3), rest[:n_numbers], work.reshape(len(work), 1),
    )  # fmt: skip


@jit
def _correct(
    samples: Any, start: int, room: int, memory: Any, floats: Any, n_numbers: int, ints: Any,
    factor: Any, floor_mm2: float, points: Any,
) -> None:  # fmt: skip
    """Compute finished points (n,) from samples (n,), the only compiled call of the live path.

    Each call from Python costs as much as its work for one sample, and each array a tenth of that.
    The joints' motion is written to the rows from *start* on.
    """
    encoders, n = memory[0].encoders, len(samples)
    q, rate, approach, tip, numbers, work = _parts(floats, room, len(encoders.radians), n_numbers)
    end, first = start + n, len(ints) - len(factor)
    q, rate, approach, tip = q[start:end], rate[start:end], approach[start:end], tip[start:end]
    still_since_ns, sizes, rows = ints[start:end], ints[room:first], ints[first:]
    flat = FlatModel(sizes, numbers, work)
    _decode_angles(samples, encoders, q)
    compute_uncorrected(q, flat, tip)
    follow(samples, q, tip, memory["motion"], rate, approach, still_since_ns)
    fill(q, rate, approach, flat, factor, rows, floor_mm2, points)
    set_flags(samples, q, still_since_ns, memory["flags"], points)


@jit
def _decode_angles(samples: Any, encoders: Any, q: Any) -> None:
    """Compute angles (n, N) rad; a joint that turns at most once is in the turn of its limits.

    A joint that reads far beyond its end stops becomes invalid.
    """
    for i in range(len(samples)):
        for k in range(q.shape[1]):
            angle = samples[i].count[k] * encoders.radians[k]
            if encoders.one_turn[k]:
                turns = math.floor((angle - encoders.middle[k]) / (2 * math.pi) + 0.5)
                angle -= 2 * math.pi * turns
                excess = max(encoders.least[k] - angle, angle - encoders.most[k])
                if excess > 0.0 and not samples[i].joint_invalid >> k & 1:
                    samples[i].joint_invalid |= 1 << k
                    if excess > encoders.excess[k]:
                        encoders.excess[k] = excess
                        encoders.farthest[k] = angle
            q[i, k] = angle


def _encoders(arm: Arm, counts_per_turn: list[int]) -> npt.NDArray[np.void]:
    """Return one record with the constants and the excess of all joints.

    It has rad per count, the middle of the range, whether the range is at most one turn, and the
    angles (rad) between which a joint can be. *excess* is how far it was beyond them since the last
    `take_beyond_stops`, *farthest* the angle there.
    """
    names = ("radians", "middle", "least", "most", "excess", "farthest")
    joints = (arm.n_joints,)
    encoders = np.zeros(1, [(name, "f8", joints) for name in names] + [("one_turn", "u1", joints)])
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

"""A measurement: the average over a rest, triggered by a button or by the rest itself.

One rule holds for all cases: a measurement averages the valid points since the tip came to rest, at
most of the last `average_s` seconds, up to the press. For a press in motion it is the single point
of the press (`count` 1, no standard deviation).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from armd import POINT, Flag
from armd.arrays import F64, I64
from armd.compiled.jit import jit, select_compiled

TriggeredBy: TypeAlias = Literal["button", "rest"]

#: A contact bounces for some milliseconds, so a shorter release does not count. No finger presses
#: twice in so short a time.
BOUNCE_NS = 30_000_000
#: Points stored at first, and at most: `average_s` at the highest rate of any wire.
ROOM, REMEMBERED = 1 << 11, 1 << 15
#: The results of `_keep`.
_UNTOUCHED, _TOUCHED, _NO_ROOM = 0, 1, 2


@dataclass(frozen=True)
class Press:
    """A press: the numbers of the buttons' bits that rose, and the row of the batch."""

    buttons: list[int]
    row: int


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """Averages over `count` points; positions in mm, base frame."""

    trigger: TriggeredBy
    seq: int
    stamp_ns: int
    monotonic_ns: int
    position_mm: list[float] | None  # None: the point of the press is invalid
    standard_deviation_mm: list[float] | None  # per axis; None for a single point
    covariance_mm2: list[float] | None  # as the last point states it; None: not calibrated
    orientation: list[float] | None
    angles_rad: list[float] | None  # (N,) as read, averaged like the position
    count: int
    duration_s: float
    still_s: float  # since the tip moved last, also before the averaged points
    flags: Flag
    buttons: int
    calibration: int  # 0: none

    def as_json(self) -> dict[str, Any]:
        return {
            **self.__dict__,
            "flags": int(self.flags),
            "flag_names": [flag.name for flag in self.flags],
            "calibration": self.calibration.to_bytes(8, "little").hex()
            if self.calibration
            else None,
        }


class Averager:
    """Stores the last points with the joints' angles, and averages a rest."""

    def __init__(self, average_s: float, n_joints: int) -> None:
        self._average_ns = round(average_s * 1e9)
        self._span_ns = self._average_ns  # for which points must stay; 0: the size is at its limit
        self._past = np.zeros(ROOM, POINT)
        self._angles = np.zeros((ROOM, n_joints))
        self._written = 0
        self._buttons = np.zeros(1, _BUTTONS)
        self._buttons["down_ns"] = -(1 << 62)  # long ago
        self._risen = np.zeros(0, np.uint32)
        self._touched = False  # a button was down in the last batch
        #: `_keep` compiled for the kinds of its arguments, which stay the same.
        self._keep: Callable[..., int] | None = None
        self._resting = False

    def remember(self, points: npt.NDArray[np.void], angles: F64) -> list[Press]:
        """Store a batch of points (n,) with angles (m ≥ n, N) rad; return its presses."""
        while True:
            arguments = points, angles, self._past, self._angles, self._written, self._span_ns
            if self._keep is None:
                self._keep = select_compiled(_keep, *arguments)
            outcome = self._keep(*arguments)
            if outcome != _NO_ROOM:
                break
            self._make_room()
        self._written += len(points)
        touched = outcome == _TOUCHED
        before, self._touched = self._touched, touched
        if not touched and not before:
            return []
        if len(points) > len(self._risen):
            self._risen = np.zeros(2 * len(points), np.uint32)
        if not _detect_presses(points, self._buttons, self._risen):
            return []
        return [
            Press([bit for bit in range(32) if risen >> bit & 1], row)
            for row, risen in enumerate(self._risen[: len(points)].tolist())
            if risen
        ]

    def find_rests(self, points: npt.NDArray[np.void]) -> list[int]:
        """Return the rows of a batch at which a rest begins to count as one (flag 9 rises)."""
        resting = (points["flags"] & Flag.AT_REST) != 0
        before = np.concatenate([[self._resting], resting[:-1]])
        self._resting = bool(resting[-1])
        return np.flatnonzero(resting & ~before).tolist()

    def average(self, trigger: TriggeredBy, point: np.void, still_since_ns: int) -> Measurement:
        """Return the measurement that ends with *point*, one of the stored ones."""
        end_ns = int(point["monotonic_ns"])
        rows = self._rows_since(max(still_since_ns, end_ns - self._average_ns))
        past = self._past[rows]
        is_used = (past["monotonic_ns"] <= end_ns) & ((past["flags"] & Flag.INVALID) == 0)
        valid = past[is_used]
        usable = len(valid) > 0 and not int(point["flags"]) & Flag.INVALID
        mean = deviation = angles = None
        if usable:
            mean = valid["position_mm"].mean(axis=0).tolist()
            angles = self._angles[rows[is_used]].mean(axis=0).tolist()
            if len(valid) > 1:
                deviation = valid["position_mm"].std(axis=0, ddof=1).tolist()
        return Measurement(
            trigger=trigger,
            seq=int(point["seq"]),
            stamp_ns=int(point["stamp_ns"]),
            monotonic_ns=end_ns,
            position_mm=mean,
            standard_deviation_mm=deviation,
            covariance_mm2=as_list_if_finite(point["covariance_mm2"]) if usable else None,
            orientation=point["orientation"].tolist() if usable else None,
            angles_rad=angles,
            count=len(valid) if usable else 0,
            duration_s=float(valid["monotonic_ns"][-1] - valid["monotonic_ns"][0]) * 1e-9
            if usable
            else 0.0,
            still_s=max(0, end_ns - still_since_ns) * 1e-9,
            flags=Flag(int(np.bitwise_or.reduce(valid["flags"]) if usable else point["flags"])),
            buttons=int(point["buttons"]),
            calibration=int(point["calibration"]),
        )

    def _rows_since(self, since_ns: int) -> I64:
        """Return the rows of the stored points from an instant on, the oldest first."""
        times = self._past["monotonic_ns"]
        room = len(times)
        low, high = max(0, self._written - room), self._written
        while low < high:
            middle = (low + high) // 2
            if times[middle % room] < since_ns:
                low = middle + 1
            else:
                high = middle
        return np.arange(low, self._written) % room

    def _make_room(self) -> None:
        """Double the number of points that can be stored, and keep the stored ones."""
        room = len(self._past)
        rows = np.arange(max(0, self._written - room), self._written)
        past, angles = np.zeros(2 * room, POINT), np.zeros((2 * room, self._angles.shape[1]))
        past[rows % (2 * room)] = self._past[rows % room]
        angles[rows % (2 * room)] = self._angles[rows % room]
        self._past, self._angles = past, angles
        if len(past) >= REMEMBERED:
            self._span_ns = 0


#: The buttons that were down at the last point, and when each was down last (monotonic).
_BUTTONS = np.dtype([("down", "i8"), ("down_ns", "i8", (32,))])


@jit
def _keep(points: Any, angles: Any, past: Any, past_angles: Any, written: int, span_ns: int) -> int:
    """Write points (n,) and angles (≥ n, N) into the ring after the *written* ones.

    Returns whether a button was down at any of them. Writes nothing and returns `_NO_ROOM` if that
    would overwrite a point that is at most *span_ns* older than its replacement.
    """
    room = len(past)
    if span_ns > 0:
        if len(points) > room:
            return _NO_ROOM
        for i in range(len(points)):
            oldest = past[(written + i) % room].monotonic_ns
            if written + i >= room and points[i].monotonic_ns - oldest <= span_ns:
                return _NO_ROOM
    outcome = _UNTOUCHED
    for i in range(len(points)):
        place = (written + i) % room
        past[place] = points[i]
        for k in range(angles.shape[1]):
            past_angles[place, k] = angles[i, k]
        if points[i].buttons != 0:
            outcome = _TOUCHED
    return outcome


@jit
def _detect_presses(points: Any, buttons: Any, risen: Any) -> bool:
    """Write the bits of buttons pressed at each of the points (n,) into *risen* (≥ n,).

    Returns whether any button was pressed.
    """
    state = buttons[0]
    pressed = False
    for i in range(len(points)):
        now, now_ns = np.int64(points[i].buttons), points[i].monotonic_ns
        fresh = np.int64(0)
        for bit in range(32):
            if now >> bit & 1:
                since_ns = now_ns - state.down_ns[bit]
                if not state.down >> bit & 1 and not 0 <= since_ns < BOUNCE_NS:
                    fresh |= np.int64(1) << bit
                state.down_ns[bit] = now_ns
        state.down = now
        risen[i] = fresh
        pressed = pressed or fresh != 0
    return pressed


def as_list_if_finite(values: npt.NDArray[np.floating[Any]]) -> list[float] | None:
    """Return the values as a list; None unless all of them are finite."""
    return values.tolist() if np.isfinite(values).all() else None

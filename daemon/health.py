"""What happened during the last second and since the start, as the health key tells it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from armd import Flag
from armd.daemon.pipeline import PointArray
from armd.drivers.sample import SampleArray


@dataclass(frozen=True)
class Second:
    """About a second of the stream, summed up."""

    seconds: float = 0.0
    points: int = 0
    invalid: int = 0
    flags: int = 0  # bits of `Flag` that any point carried
    flagged: dict[str, int] = field(default_factory=dict)  # points by flag name
    invalid_joints: tuple[int, ...] = ()
    warning_joints: tuple[int, ...] = ()
    latency_ms: dict[str, float] = field(default_factory=dict)  # latch to put: p50, p99, max

    @property
    def rate_hz(self) -> float:
        return self.points / self.seconds if self.seconds else 0.0


class Tally:
    """Collects batches as they pass, which costs the stream next to nothing, and sums them up
    when the second is over."""

    def __init__(self, now_ns: int) -> None:
        self.published = 0
        self.flagged: Counter[str] = Counter()  # since the start
        self._since_ns = now_ns
        self._points: list[PointArray] = []
        self._samples: list[SampleArray] = []
        self._latency_ns: list[int] = []

    def add(self, points: PointArray, samples: SampleArray, published_ns: int) -> None:
        """A batch and its samples, put at *published_ns* (CLOCK_MONOTONIC)."""
        self._points.append(points)
        self._samples.append(samples)
        self._latency_ns.append(published_ns - int(points["monotonic_ns"][-1]))

    def close_second(self, now_ns: int) -> Second:
        """Sum up what came since the last call."""
        seconds = (now_ns - self._since_ns) * 1e-9
        self._since_ns = now_ns
        if not self._points:
            return Second(seconds)
        flags = np.concatenate([points["flags"] for points in self._points])
        flagged = {flag.name or "": int((flags & flag > 0).sum()) for flag in Flag}
        flagged = {name: count for name, count in flagged.items() if count}
        latency_ms = np.array(self._latency_ns) * 1e-6
        p50, p99 = np.percentile(latency_ms, [50, 99])
        second = Second(
            seconds,
            points=len(flags),
            invalid=flagged.get("INVALID", 0),
            flags=int(np.bitwise_or.reduce(flags)),
            flagged=flagged,
            invalid_joints=self._joints("joint_invalid"),
            warning_joints=self._joints("joint_warning"),
            latency_ms={
                "p50": round(float(p50), 3),
                "p99": round(float(p99), 3),
                "max": round(float(latency_ms.max()), 3),
            },
        )
        self.published += second.points
        self.flagged.update(flagged)
        self._points, self._samples, self._latency_ns = [], [], []
        return second

    def _joints(self, name: str) -> tuple[int, ...]:
        """Numbers of the joints whose bit stood in any sample."""
        bits = 0
        for samples in self._samples:
            bits |= int(np.bitwise_or.reduce(samples[name]))
        return tuple(k for k in range(1, 17) if bits >> (k - 1) & 1)

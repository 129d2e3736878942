"""The device's clock seen from the host: PING and PONG, weighed by their round trips.

The instant at which the arm stamped a PONG lies somewhere between sending the PING and receiving
the PONG; by how much a round trip exceeds the shortest one, so much was somebody late. Offset and
drift are the least-squares line through the last exchanges, each weighed by that lateness: the
quickest decide, the others hardly count.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from armd.jit import jit

WINDOW = 64  # exchanges remembered
ENOUGH = 8  # exchanges before the mapping is trusted
EAGER = 24  # exchanges asked for quickly after a connection
EAGER_INTERVAL_NS = 50_000_000
INTERVAL_NS = 500_000_000
DRIFT_PRIOR = 100e-6  # crystals differ by this much; what holds until the window is long enough
FLOOR_NS = 10_000.0  # noise that a round trip does not show


class DeviceClock:
    """Device microseconds since boot → nanoseconds of the host's CLOCK_MONOTONIC."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything: another boot, another connection."""
        self._exchanges: deque[tuple[int, int, int]] = deque(maxlen=WINDOW)
        self._device_ns = 0  # the line's anchor, on both clocks
        self._host_ns = 0
        self.drift = 0.0  # host seconds gained per device second

    @property
    def mapped(self) -> bool:
        return len(self._exchanges) >= ENOUGH

    @property
    def ping_interval_ns(self) -> int:
        return EAGER_INTERVAL_NS if len(self._exchanges) < EAGER else INTERVAL_NS

    @property
    def round_trip_ns(self) -> int | None:
        """The shortest round trip in the window."""
        return min((round_trip for _, _, round_trip in self._exchanges), default=None)

    def add(self, sent_ns: int, received_ns: int, device_ns: int) -> None:
        """One exchange: PING sent and PONG received by the host's clock, stamped by the arm's."""
        if received_ns < sent_ns:
            return
        middle = (sent_ns + received_ns) // 2
        self._exchanges.append((device_ns, middle, received_ns - sent_ns))
        self._fit()

    @property
    def line(self) -> tuple[int, int, float]:
        """What `host_ns` takes: an instant on both clocks, and the drift."""
        return self._device_ns, self._host_ns, self.drift

    def to_host(self, device_ns: int) -> int:
        """An instant on the host's clock; only meaningful while `mapped`."""
        return int(host_ns(device_ns, *self.line))

    def _fit(self) -> None:
        anchor, host, _ = self._exchanges[-1]
        device, middle, round_trip = np.array(self._exchanges, dtype=np.int64).T
        u = (device - anchor).astype(np.float64)  # before the anchor: negative
        y = ((middle - host) - (device - anchor)).astype(np.float64)
        w = (FLOOR_NS + round_trip - round_trip.min()) ** -2.0
        # Normal equations of y = a + b·u with the prior b = 0 ± DRIFT_PRIOR.
        s, su, sy = w.sum(), w @ u, w @ y
        suu, suy = w @ (u * u) + DRIFT_PRIOR**-2, w @ (u * y)
        self.drift = float((s * suy - su * sy) / (s * suu - su * su))
        self._device_ns = anchor
        self._host_ns = host + round(float((sy - self.drift * su) / s))


@jit
def host_ns(device_ns: Any, anchor_device_ns: int, anchor_host_ns: int, drift: float) -> Any:
    """The host's instant of the device's, on the line through an instant of both."""
    since = device_ns - anchor_device_ns
    return anchor_host_ns + since + np.int64(np.rint(since * drift))

"""The device's clock seen from the host: PING and PONG, weighed by their round trips.

The instant at which the arm stamped a PONG lies somewhere between sending the PING and receiving
the PONG; by how much a round trip exceeds the shortest one, so much was somebody late. Offset and
drift are the least-squares line through the last exchanges, each weighed by that lateness: the
quickest decide, the others hardly count.

No line is better than what it rests on. An exchange bounds the device's clock on both sides, so
two of them can contradict each other by more than any crystal drifts: the clock jumped, or an
answer was false, and all begins anew. What is mapped holds for samples that did not arrive before
their own instant, and for a while after the last exchange.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from armd.compiled.jit import jit

WINDOW = 64  # exchanges remembered
ENOUGH = 8  # exchanges before the mapping is trusted
EAGER = 24  # exchanges asked for quickly after a connection
EAGER_INTERVAL_NS = 50_000_000
INTERVAL_NS = 500_000_000
DRIFT_PRIOR = 100e-6  # crystals differ by this much; what holds until the window is long enough
FLOOR_NS = 10_000.0  # noise that a round trip does not show
PROMISED_NS = 5_000_000  # stamps are right by this much, or flagged
MOST_DRIFT = 500e-6  # beyond this it is no crystal, or no line
STAMP_NS = 1_000_000  # by how much a device may stamp a PONG beside its instant
OLD_NS = 30_000_000_000  # after so long without an exchange drift may have used up the promise

#: The line from the device's clock to the host's: an instant on both, and the slope.
_LINE = np.dtype([("mapped", "?"), ("device_ns", "i8"), ("host_ns", "i8"), ("drift", "f8")])


class ClockMapping:
    """Device microseconds since boot → nanoseconds of the host's CLOCK_MONOTONIC."""

    def __init__(self, noise_ns: float = FLOOR_NS) -> None:
        """*noise_ns*: of an exchange, beside what its round trip shows."""
        self._noise_ns = noise_ns
        #: What `compute_host_ns` takes. `drift`: host seconds gained per device second.
        self.line = np.zeros(1, _LINE)
        self.reset()

    def reset(self) -> None:
        """Forget everything: another boot, another connection."""
        #: device, sent and received
        self._exchanges: deque[tuple[int, int, int]] = deque(maxlen=WINDOW)
        self.line[0] = (False, 0, 0, 0.0)

    @property
    def mapped(self) -> bool:
        return bool(self.line["mapped"][0])

    @property
    def ping_interval_ns(self) -> int:
        return EAGER_INTERVAL_NS if len(self._exchanges) < EAGER else INTERVAL_NS

    def add(self, sent_ns: int, received_ns: int, device_ns: int) -> bool:
        """One exchange: PING sent and PONG received by the host's clock, stamped by the arm's.

        False if it contradicts those before, which are forgotten then.
        """
        if received_ns < sent_ns:
            return True
        agrees = self._agrees(sent_ns, received_ns, device_ns)
        if not agrees:
            self.reset()
        self._exchanges.append((device_ns, sent_ns, received_ns))
        self._fit()
        return agrees

    def _agrees(self, sent_ns: int, received_ns: int, device_ns: int) -> bool:
        """Whether one clock can have stamped all these answers while they were under way."""
        if not self._exchanges:
            return True
        device, sent, received = np.array(self._exchanges, dtype=np.int64).T
        elapsed_ns = device_ns - device
        allowed = STAMP_NS + MOST_DRIFT * np.abs(elapsed_ns)
        least_ns, most_ns = sent_ns - received, received_ns - sent  # by the host's clock
        return bool(((least_ns - allowed <= elapsed_ns) & (elapsed_ns <= most_ns + allowed)).all())

    def to_host(self, device_ns: int) -> int:
        """An instant on the host's clock; only meaningful while `mapped`."""
        return int(compute_host_ns(device_ns, self.line))

    def _fit(self) -> None:
        device, sent, received = np.array(self._exchanges, dtype=np.int64).T
        middle, round_trip = (sent + received) // 2, received - sent
        anchor, host = int(device[-1]), int(middle[-1])
        u = (device - anchor).astype(np.float64)  # before the anchor: negative
        y = ((middle - host) - (device - anchor)).astype(np.float64)
        w = (self._noise_ns + round_trip - round_trip.min()) ** -2.0
        # Normal equations of y = a + b·u with the prior b = 0 ± DRIFT_PRIOR.
        s, su, sy = w.sum(), w @ u, w @ y
        suu, suy = w @ (u * u) + DRIFT_PRIOR**-2, w @ (u * y)
        drift = float((s * suy - su * sy) / (s * suu - su * su))
        mapped = (
            len(self._exchanges) >= ENOUGH
            and abs(drift) <= MOST_DRIFT
            and bool(round_trip.min() <= 2 * PROMISED_NS)
        )
        self.line[0] = (mapped, anchor, host + round(float((sy - drift * su) / s)), drift)


@jit
def compute_host_ns(device_ns: Any, line: Any) -> Any:
    """The host's instant of the device's, by a `ClockMapping`'s line."""
    since = device_ns - line[0].device_ns
    return line[0].host_ns + since + np.int64(np.rint(since * line[0].drift))


@jit
def can_promise(device_ns: Any, instant_ns: Any, arrival_ns: Any, line: Any) -> Any:
    """Whether *instant_ns*, the host's of *device_ns* by the line, can be promised for a sample
    that arrived at *arrival_ns*."""
    return (
        line[0].mapped
        and instant_ns <= arrival_ns + PROMISED_NS
        and device_ns - line[0].device_ns <= OLD_NS
    )

"""Maps the device's clock to the host's: PING and PONG, weighted by their round trips.

The arm stamped a PONG between the sending of the PING and the arrival of the PONG. The excess of a
round trip over the shortest one is lateness. Offset and drift are the least-squares line through
the last exchanges, each weighted by its lateness: the quickest ones dominate.

An exchange bounds the device's clock on both sides. So two exchanges can contradict each other by
more than any crystal drifts: then the clock jumped, or an answer was false, and the mapping starts
again. The mapping is valid for samples that arrived after their own instant, and for a limited time
after the last exchange.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from armd.compiled.jit import jit

WINDOW = 64  # number of exchanges kept
ENOUGH = 8  # number of exchanges before the mapping is used
EAGER = 24  # number of quick exchanges after a connection
EAGER_INTERVAL_NS = 50_000_000
INTERVAL_NS = 500_000_000
DRIFT_PRIOR = 100e-6  # prior of the drift: crystals differ by this much
FLOOR_NS = 10_000.0  # noise that is not in the round trip
PROMISED_NS = 5_000_000  # stamps have at most this error, or are flagged
MOST_DRIFT = 500e-6  # a larger drift is not that of a crystal
STAMP_NS = 1_000_000  # largest error of a device's stamp of a PONG
OLD_NS = 30_000_000_000  # after this time without an exchange, drift may exceed the promise

#: The line from the device's clock to the host's: an instant on both, and the slope.
_LINE = np.dtype([("mapped", "?"), ("device_ns", "i8"), ("host_ns", "i8"), ("drift", "f8")])


class ClockMapping:
    """Maps device microseconds since boot to nanoseconds of the host's CLOCK_MONOTONIC."""

    def __init__(self, noise_ns: float = FLOOR_NS) -> None:
        """Start without exchanges; *noise_ns*: noise of an exchange that its round trip does not
        show.
        """
        self._noise_ns = noise_ns
        #: The argument of `compute_host_ns`. `drift`: host seconds gained per device second.
        self.line = np.zeros(1, _LINE)
        self.reset()

    def reset(self) -> None:
        """Forget all exchanges, after another boot or connection."""
        #: times: device, sent and received, ns
        self._exchanges: deque[tuple[int, int, int]] = deque(maxlen=WINDOW)
        self.line[0] = (False, 0, 0, 0.0)

    @property
    def mapped(self) -> bool:
        return bool(self.line["mapped"][0])

    @property
    def ping_interval_ns(self) -> int:
        return EAGER_INTERVAL_NS if len(self._exchanges) < EAGER else INTERVAL_NS

    def add(self, sent_ns: int, received_ns: int, device_ns: int) -> bool:
        """Add one exchange: PING sent and PONG received by the host's clock, stamped by the arm's.

        Returns False if it contradicts earlier exchanges, which are then forgotten.
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
        """Return whether one clock can have stamped all these answers while they were under way."""
        if not self._exchanges:
            return True
        device, sent, received = np.array(self._exchanges, dtype=np.int64).T
        elapsed_ns = device_ns - device
        allowed = STAMP_NS + MOST_DRIFT * np.abs(elapsed_ns)
        least_ns, most_ns = sent_ns - received, received_ns - sent  # by the host's clock
        return bool(((least_ns - allowed <= elapsed_ns) & (elapsed_ns <= most_ns + allowed)).all())

    def to_host(self, device_ns: int) -> int:
        """Return an instant on the host's clock; only meaningful while `mapped`."""
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
    """Convert the device's instant to the host's, by a `ClockMapping`'s line."""
    since = device_ns - line[0].device_ns
    return line[0].host_ns + since + np.int64(np.rint(since * line[0].drift))


@jit
def can_promise(device_ns: Any, instant_ns: Any, arrival_ns: Any, line: Any) -> Any:
    """Return whether *instant_ns* has at most the promised error for a sample.

    *instant_ns*: the host's instant of *device_ns* by the line; *arrival_ns*: the sample's arrival.
    """
    return (
        line[0].mapped
        and instant_ns <= arrival_ns + PROMISED_NS
        and device_ns - line[0].device_ns <= OLD_NS
    )

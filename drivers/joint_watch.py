"""Joints that turn invalid, and turn good again, as events: one each, however they flicker."""

from __future__ import annotations

import numpy as np

from armd.drivers.sample import Event, SampleArray

GOOD_FOR_NS = 500_000_000  # so long must a joint hold before it counts as recovered


class JointWatch:
    """Remembers which joints are in trouble, and since when they are not."""

    def __init__(self) -> None:
        self._last_bad_ns: dict[int, int] = {}  # joint (from 1) → device_ns

    def events(self, samples: SampleArray) -> list[Event]:
        """Events that *samples* (one run, in order) give rise to."""
        bits = int(np.bitwise_or.reduce(samples["joint_invalid"]))
        if not bits and not self._last_bad_ns:
            return []
        device_ns, now_ns = int(samples["device_ns"][-1]), int(samples["monotonic_ns"][-1])
        found = []
        for k in range(1, samples["count"].shape[1] + 1):
            bad = (samples["joint_invalid"] >> (k - 1)) & 1
            if bits >> (k - 1) & 1:
                if k not in self._last_bad_ns:
                    text = f"joint {k} is invalid: its status bit is set or its count jumped"
                    found.append(Event("joint_invalid", text, now_ns, "error", {"joint": k}))
                self._last_bad_ns[k] = int(samples["device_ns"][np.flatnonzero(bad)[-1]])
            elif k in self._last_bad_ns and not (
                0 <= device_ns - self._last_bad_ns[k] < GOOD_FOR_NS
            ):
                del self._last_bad_ns[k]
                text = f"joint {k} is valid again"
                found.append(Event("joint_valid", text, now_ns, "info", {"joint": k}))
        return found

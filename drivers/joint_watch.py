"""Joints that get into trouble, and out of it, as events: one each, however they flicker."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from armd.drivers.sample import Event, SampleArray

GOOD_FOR_NS = 500_000_000  # so long must a joint hold before it counts as recovered


class JointWatch:
    """Watches one kind of trouble. The events are *kind* and then "joint_valid"."""

    def __init__(self, kind: str, trouble: str, over: str, names: Sequence[str] = ()) -> None:
        """*trouble*: what follows "joint 3: "; *over*: what follows "joint 3 is valid again: ";
        *names* of the joints, if they are called more than "joint 3"."""
        self._kind = kind
        self._trouble = trouble
        self._over = over
        self._names = names
        self._last_bad_ns: dict[int, int] = {}  # joint (from 1) → device_ns

    @property
    def active(self) -> bool:
        """Some joint has not recovered yet."""
        return bool(self._last_bad_ns)

    def events(self, samples: SampleArray, bad: npt.NDArray[np.uint16]) -> list[Event]:
        """What *bad* (m,), bit k-1 for joint k, of the consecutive *samples* (m,) gives rise to."""
        if not self._last_bad_ns and not bad.any():
            return []
        device_ns, now_ns = int(samples["device_ns"][-1]), int(samples["monotonic_ns"][-1])
        events = []
        for k in range(1, samples["count"].shape[1] + 1):
            rows = np.flatnonzero((bad >> (k - 1)) & 1)
            if len(rows):
                if k not in self._last_bad_ns:
                    text = f"{self._name(k)}: {self._trouble}"
                    events.append(Event(self._kind, text, now_ns, "error", {"joint": k}))
                self._last_bad_ns[k] = int(samples["device_ns"][rows[-1]])
            elif k in self._last_bad_ns and not (
                0 <= device_ns - self._last_bad_ns[k] < GOOD_FOR_NS
            ):
                del self._last_bad_ns[k]
                text = f"{self._name(k)} is valid again: {self._over}"
                events.append(Event("joint_valid", text, now_ns, "info", {"joint": k}))
        return events

    def _name(self, k: int) -> str:
        return self._names[k - 1] if self._names else f"joint {k}"

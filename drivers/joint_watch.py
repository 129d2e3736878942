"""Events of joints that fail and recover: one event each, even if a fault flickers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from armd.drivers.sample import Event, SampleArray

GOOD_FOR_NS = 500_000_000  # a joint must be good for this long to count as recovered


class JointWatch:
    """Watches one kind of fault. It emits events of *kind*, and "joint_valid" on recovery."""

    def __init__(self, kind: str, trouble: str, over: str, names: Sequence[str] = ()) -> None:
        """Take the texts of the events.

        *trouble* follows "joint 3: "; *over* follows "joint 3 is valid again: "; *names* replace
        "joint 3", if given.
        """
        self._kind = kind
        self._trouble = trouble
        self._over = over
        self._names = names
        self._last_bad_ns: dict[int, int] = {}  # joint (from 1) → device_ns

    @property
    def active(self) -> bool:
        """Whether some joint has not recovered yet."""
        return bool(self._last_bad_ns)

    def events(self, samples: SampleArray, bad: npt.NDArray[np.uint16]) -> list[Event]:
        """Return the events of consecutive *samples* (m,).

        *bad* (m,) marks the faulty joints: bit k-1 for joint k.
        """
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

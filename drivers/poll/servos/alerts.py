"""Faults that servos report: overload, heat, voltage. Their positions are still valid."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from armd.drivers.joint_watch import GOOD_FOR_NS
from armd.drivers.sample import Event


class Alert(NamedTuple):
    bits: int  # all bits since it began
    seen_ns: int  # when last seen
    words: str


class Alerts:
    """The alerts of one line, by servo; an event when one begins or changes, and when it ends."""

    def __init__(
        self, name: Callable[[int], str], words: Callable[[int], str], has_register: bool
    ) -> None:
        """Take functions for the *name* of a servo, and for the *words* of its fault bits.

        *has_register*: the bits are in their own register, which is read when an answer raises an
        alert.
        """
        self._name = name
        self._words = words
        self._has_register = has_register
        self._current: dict[int, Alert] = {}

    @property
    def servos(self) -> list[int]:
        """The servos with an alert."""
        return list(self._current)

    @property
    def reasons(self) -> list[str]:
        """One phrase for each of these servos."""
        return [
            f"{self._name(servo)} complains: {alert.words}"
            for servo, alert in self._current.items()
        ]

    def forget(self, servo: int) -> None:
        self._current.pop(servo, None)

    def forget_all(self) -> None:
        self._current.clear()

    def update(self, servo: int, bits: int, now_ns: int) -> list[Event]:
        """Take the error bits of an answer; the end of an alert is reported 0.5 s later."""
        before = self._current.get(servo)
        if bits:
            all_bits = bits | (before.bits if before else 0)
            if before and all_bits == before.bits:
                self._current[servo] = before._replace(seen_ns=now_ns)
                return []
            words = "an alert" if self._has_register else self._words(bits)
            return self._note(servo, Alert(all_bits, now_ns, words), now_ns)
        if before is None or now_ns - before.seen_ns < GOOD_FOR_NS:
            return []
        del self._current[servo]
        text = f"{self._name(servo)} complains no more ({before.words})"
        return [Event("servo_warning", text, now_ns, "info", {"servo": servo})]

    def explain(self, servo: int, bits: int, now_ns: int) -> list[Event]:
        """Take the alarm register of a servo with an alert; return an event with its reason."""
        alert = self._current.get(servo)
        if alert is None or not bits or self._words(bits) == alert.words:
            return []
        return self._note(servo, alert._replace(words=self._words(bits)), now_ns)

    def _note(self, servo: int, alert: Alert, now_ns: int) -> list[Event]:
        self._current[servo] = alert
        text = f"{self._name(servo)} complains: {alert.words}; its position still holds"
        detail: dict[str, Any] = {"servo": servo, "trouble": alert.words}
        return [Event("servo_warning", text, now_ns, "warning", detail)]

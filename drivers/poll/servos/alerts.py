"""What servos complain of: overload, heat, voltage. Their positions still hold."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from armd.drivers.joint_watch import GOOD_FOR_NS
from armd.drivers.sample import Event


class Alert(NamedTuple):
    bits: int  # all since it began
    seen_ns: int  # last
    words: str


class Alerts:
    """Of one line, by servo; one event as trouble begins or changes, one as it is over."""

    def __init__(
        self, name: Callable[[int], str], words: Callable[[int], str], has_register: bool
    ) -> None:
        """*name* of a servo, and *words* for the bits of its trouble; *has_register*: these are in
        a register of their own, which is asked for when an answer raises an alert."""
        self._name = name
        self._words = words
        self._has_register = has_register
        self._current: dict[int, Alert] = {}

    @property
    def servos(self) -> list[int]:
        """Those in trouble."""
        return list(self._current)

    @property
    def reasons(self) -> list[str]:
        """One phrase for each of these."""
        return [
            f"{self._name(servo)} complains: {alert.words}"
            for servo, alert in self._current.items()
        ]

    def forget(self, servo: int) -> None:
        self._current.pop(servo, None)

    def forget_all(self) -> None:
        self._current.clear()

    def update(self, servo: int, bits: int, now_ns: int) -> list[Event]:
        """The trouble in the error byte of an answer; its end is reported 0.5 s later."""
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
        """That register of a servo in trouble."""
        alert = self._current.get(servo)
        if alert is None or not bits or self._words(bits) == alert.words:
            return []
        return self._note(servo, alert._replace(words=self._words(bits)), now_ns)

    def _note(self, servo: int, alert: Alert, now_ns: int) -> list[Event]:
        self._current[servo] = alert
        text = f"{self._name(servo)} complains: {alert.words}; its position still holds"
        detail: dict[str, Any] = {"servo": servo, "trouble": alert.words}
        return [Event("servo_warning", text, now_ns, "warning", detail)]

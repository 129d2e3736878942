"""The state of all servos: their identity, whether they answer, and their faults."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from armd.drivers.poll.protocol.family import Family, Servo, find_model_name
from armd.drivers.poll.servos.alerts import Alerts
from armd.drivers.poll.servos.doubles import Doubles
from armd.drivers.sample import Event

#: A servo without an answer for longer is absent: one that is asked in each cycle, and one whose
#: temperature alone is read.
ABSENT_AFTER_NS, ABSENT_AT_LEISURE_NS = 500_000_000, 1_600_000_000
#: A joint's servo without an answer for longer may have restarted meanwhile.
ASK_AGAIN_AFTER_NS = 100_000_000
SUSPECT_EVERY_NS = 50_000_000
GIVEN_UP_AFTER = 3


class Roster:
    """The state of the servos of one line, by id."""

    def __init__(
        self, family: Family, ids: Sequence[int], often: Sequence[int], everyone: Sequence[int]
    ) -> None:
        """Take *ids* of the joints, and the larger groups.

        *often*: also the button, asked in each cycle; *everyone*: also servos whose temperature
        alone is read.
        """
        self._family = family
        self._joint = {servo: k for k, servo in enumerate(ids, 1)}
        self._often = often
        self._everyone = everyone
        self.servos: dict[int, Servo] = {}  # identified since they were last absent
        self.version = 0  # grows whenever `servos` changes
        self.changed: dict[int, list[str]] = {}  # differences of their geometry
        self.refused: dict[int, str] = {}  # why a servo cannot be read
        self.foreign = ""  # why this is a foreign arm; empty if it is not
        self.heard_ns: dict[int, int] = {}  # when each last answered
        #: servos that answered a single read, but no sync read, before they were identified
        self.single_answers: set[int] = set()
        self.suspects: set[int] = set()  # servos to be identified again at once
        self._suspected_ns: dict[int, int] = {}  # when each was last suspected
        self.wants_warmth = False  # a servo is back, and its temperature is not known
        self.doubles = Doubles(often)
        self._misses: Counter[int] = Counter()  # missed cycles in a row
        has_register = family.alarm is not None
        self.alerts = Alerts(self.name, family.complaints, has_register)
        self._announced: dict[int, Servo] = {}
        self._torque: set[int] = set()

    def name(self, servo: int) -> str:
        joint = self._joint.get(servo)
        return f"servo {servo} (joint {joint})" if joint else f"servo {servo}"

    def model(self, servo: int) -> int | None:
        """Return the model that the servo last reported."""
        announced = self._announced.get(servo)
        return None if announced is None else announced.model

    @property
    def unusable(self) -> int:
        """Bits of joints whose servos are not identified, changed or refused."""
        if self.foreign:
            return (1 << len(self._joint)) - 1
        bits = 0
        for servo, joint in self._joint.items():
            if servo not in self.servos or servo in self.changed or servo in self.refused:
                bits |= 1 << (joint - 1)
        return bits

    def forget(self) -> None:
        """Forget all servos: in another connection each must be identified again."""
        self.servos.clear()
        self.single_answers.clear()
        self.version += 1
        self.heard_ns.clear()
        self._misses.clear()
        self.doubles.forget_all()
        self.suspects.clear()
        self.alerts.forget_all()
        self.changed.clear()
        self.refused.clear()
        self.foreign = ""

    def state(self) -> dict[str, Any]:
        """Return the state for `restore` in a replay, as JSON."""
        return {
            "heard": self.heard_ns,
            "servos": {servo: identified.as_json() for servo, identified in self.servos.items()},
            "changed": self.changed,
            "doubles": self.doubles.state(),
        }

    def restore(self, state: dict[str, Any], now_ns: int) -> None:
        """Continue from *state*."""
        for servo, registers in state["servos"].items():
            self.identify(int(servo), Servo(**registers), now_ns)
        self.heard_ns = {int(servo): at_ns for servo, at_ns in state["heard"].items()}
        self.changed = {int(servo): phrases for servo, phrases in state["changed"].items()}
        self.doubles.restore(state.get("doubles", ()))  # older recordings lack it

    # --- who they are ----------------------------------------------------------------------

    def identify(self, servo: int, identified: Servo, now_ns: int) -> list[Event]:
        """Record the registers of a servo; return events."""
        before = self._announced.get(servo)
        self.single_answers.discard(servo)
        self.wants_warmth |= servo not in self.servos
        if self.servos.get(servo) != identified:
            self.servos[servo] = self._announced[servo] = identified
            self.version += 1
        self.heard_ns[servo] = now_ns
        events = self._refuse(servo, self._family.refusal(identified), now_ns)
        if (
            before is None
            or before.geometry != identified.geometry
            or before.firmware != identified.firmware
        ):
            is_known = identified.model in self._family.models
            model = find_model_name(identified.model, self._family.models)
            text = f"{self.name(servo)} is a {model}, firmware {identified.firmware}"
            if not is_known:
                text += ", which is not known here; it is read by its family's common registers"
            detail = {"servo": servo, **identified.as_json()}
            events.append(Event("servo", text, now_ns, "info" if is_known else "warning", detail))
        return events + self._torque_events(servo, identified.torque, now_ns)

    def _refuse(self, servo: int, why: str, now_ns: int) -> list[Event]:
        if why == self.refused.get(servo, ""):
            return []
        self.refused[servo] = why
        if not why:
            del self.refused[servo]
            return []
        text = f"{self.name(servo)}: {why}; none of its values is valid"
        return [Event("servo_refused", text, now_ns, "error", {"servo": servo})]

    def _torque_events(self, servo: int, on: bool, now_ns: int) -> list[Event]:
        if on == (servo in self._torque):
            return []
        detail = {"servo": servo}
        if on:
            self._torque.add(servo)
            text = f"{self.name(servo)}: {self._family.register('torque')}: found 1 (on, it holds "
            text += (
                "the joint), expected 0; switch it off with torque_off = true in [driver], or by"
            )
            text += " the power supply"
            return [Event("torque_on", text, now_ns, "error", detail)]
        self._torque.discard(servo)
        text = f"{self.name(servo)}: its torque is off now"
        return [Event("torque_off", text, now_ns, "info", detail)]

    def miss(self, servos: Sequence[int], port: str, now_ns: int) -> list[Event]:
        """Return events of servos that were not identified when a connection began."""
        return [
            Event(
                "servo_missing",
                self._missing(servo, port),
                now_ns,
                "error",
                {"servo": servo},
            )
            for servo in servos
        ]

    def _missing(self, servo: int, port: str) -> str:
        actual = "two answers that differ" if servo in self.doubles else "no answer"
        text = f"{self.name(servo)}: found {actual} on {port} to id {servo}, expected one"
        return f"{text}: check its cable and its id"

    def judge(
        self, changed: dict[int, list[str]], first: bool, arm: str, now_ns: int
    ) -> list[Event]:
        """Record the servos whose geometry has *changed* since it was accepted; return events.

        *first*: the first verdict of this connection; *arm*: the serial number.
        """
        before = self.changed
        absent = {s: phrases for s, phrases in before.items() if s not in self.servos}
        self.changed = changed = absent | changed
        events: list[Event] = []
        for servo, phrases in changed.items():
            if before.get(servo) == phrases:
                continue
            text = f"{self.name(servo)}: {'; '.join(phrases)}; the arm's geometry no"
            text += " longer holds, nothing valid is published: put it back, or measure the arm"
            text += " anew and say `armd accept CONFIG`"
            kind = "foreign_arm" if phrases[0].startswith("model") else "offsets_changed"
            events.append(Event(kind, text, now_ns, "error", {"servo": servo, "found": phrases}))
        if before and not changed:
            text = "the servos' offsets are those that are accepted"
            events.append(Event("offsets_accepted", text, now_ns, "info"))
        if first and not changed:
            text = f"arm {arm}: {len(self.servos)} of {len(self._everyone)} servos identified"
            events.append(Event("identified", text, now_ns, "info"))
        return events

    # --- how they do -----------------------------------------------------------------------

    def heard(self, servo: int, now_ns: int) -> None:
        self.heard_ns[servo] = now_ns
        self._misses[servo] = 0
        self.doubles.heard(servo, now_ns)

    def silent(self, servo: int, now_ns: int) -> None:
        """Record a missing answer; after a while the servo must be identified again."""
        self._misses[servo] += 1
        absent = self._absent(servo, now_ns)
        quiet_ns = now_ns - self.heard_ns.get(servo, 0)
        away = self.given_up(servo) and quiet_ns > ASK_AGAIN_AFTER_NS
        if (absent or (away and servo in self._often)) and self.servos.pop(servo, None) is not None:
            self.version += 1
        if absent:
            self.heard_ns.pop(servo, None)
            self.alerts.forget(servo)
            self.doubles.forget(servo)

    def suspect(self, servo: int, now_ns: int) -> None:
        """Record that its count jumped: another homing offset looks like that."""
        if now_ns - self._suspected_ns.get(servo, 0) > SUSPECT_EVERY_NS:
            self._suspected_ns[servo] = now_ns
            self.suspects.add(servo)

    def ask_anew(self, servo: int) -> None:
        """Ignore the servo until it has been identified again."""
        if self.servos.pop(servo, None) is not None:
            self.version += 1

    def contradicted(self, servos: Iterable[int], now_ns: int) -> list[Event]:
        """Record servos with two answers that differ; return an event if it goes on.

        Each must be identified again.
        """
        events = []
        for servo in sorted(servos):
            self.ask_anew(servo)
            if self.doubles.contradicted(servo, now_ns):
                text = f"{self.name(servo)}: {self._twice(servo)}; none of its values is valid"
                events.append(Event("duplicate_id", text, now_ns, "error", {"servo": servo}))
        return events

    def _twice(self, servo: int) -> str:
        actual = "found two answers that differ, expected one: are there two servos of this id?"
        return f"id (register {self._family.id_register}): {actual}"

    def given_up(self, servo: int) -> bool:
        """Return whether it has not answered for some cycles: then wait for its slot only."""
        return self._misses[servo] >= GIVEN_UP_AFTER

    def _absent(self, servo: int, now_ns: int) -> bool:
        patience_ns = ABSENT_AFTER_NS if servo in self._often else ABSENT_AT_LEISURE_NS
        return now_ns - self.heard_ns.get(servo, 0) > patience_ns

    @property
    def strangers(self) -> list[int]:
        """The servos that answer without contradiction, and are not identified."""
        return [
            servo
            for servo in self.heard_ns
            if servo not in self.servos and servo not in self.doubles and not self._misses[servo]
        ]

    def hindrance(self, now_ns: int) -> str:
        """Return why nobody can measure, in words; "" if there is no reason."""
        if self.foreign:
            return self.foreign
        for servo, why in self.refused.items():
            return f"{self.name(servo)}: {why}"
        for servo, phrases in self.changed.items():
            return f"{self.name(servo)}: {'; '.join(phrases)}; nothing is valid until accepted"
        reasons = [f"{self.name(servo)}: {self._twice(servo)}" for servo in self.doubles.certain]
        for servo in self._everyone:
            if self._absent(servo, now_ns):
                reasons.append(f"{self.name(servo)} does not answer")
        torque = sorted(self._torque & self.servos.keys())
        reasons += [f"{self.name(servo)}: its torque is on" for servo in torque]
        reasons += self.alerts.reasons
        return "; ".join(reasons)

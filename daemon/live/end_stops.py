"""Joints that read far beyond their end stops, as events and in words."""

from __future__ import annotations

from armd.compensation.model.arm import Arm
from armd.drivers.sample import Event

#: Time within the end stops after which a joint counts as back, so that flicker is ignored.
BACK_AFTER_NS = 500_000_000


class EndStopWatch:
    """Watches joints beyond their end stops; `look` is called 20 times a second."""

    def __init__(self, arm: Arm) -> None:
        self._limits = {k: (joint.min_deg, joint.max_deg) for k, joint in enumerate(arm.joint, 1)}
        self._beyond: dict[int, tuple[str, int]] = {}  # joint → description, last time seen

    @property
    def hindrance(self) -> str:
        """The reason why a person cannot measure; "" if there is none."""
        return next((text for text, _ in self._beyond.values()), "")

    def look(self, beyond_deg: dict[int, float], now_ns: int) -> list[Event]:
        """Return the events of joints that went beyond their end stops or came back.

        *beyond_deg* has the joints that read beyond since the last call, with the farthest angle.
        """
        events = []
        for joint, angle_deg in beyond_deg.items():
            entry = self._beyond.get(joint)
            text = entry[0] if entry else self._describe(joint, angle_deg)
            self._beyond[joint] = text, now_ns
            if entry is None:
                detail = {"joint": joint, "angle_deg": round(angle_deg, 2)}
                events.append(Event("beyond_end_stop", text, now_ns, "error", detail))
        for joint, (_, seen_ns) in list(self._beyond.items()):
            if now_ns - seen_ns >= BACK_AFTER_NS:
                del self._beyond[joint]
                text = f"joint {joint} is valid again: it is within its end stops"
                events.append(Event("joint_valid", text, now_ns, "info", {"joint": joint}))
        return events

    def _describe(self, joint: int, angle_deg: float) -> str:
        low, high = self._limits[joint]
        stop = low if low is not None and angle_deg < low else high
        assert stop is not None  # or it could not be beyond
        return (
            f"joint {joint}: found {angle_deg:.1f}°, {abs(angle_deg - stop):.0f}"
            f"° beyond its end stop at {stop:g}°: its encoder is stuck or"
            " broken, or min_deg and max_deg of arm.toml are wrong"
        )

"""Group a flood of events of one kind: the first ones, then the number of further ones."""

from __future__ import annotations

from dataclasses import dataclass, replace

from armd.drivers.sample import Event

#: Events of a kind that are passed singly: so many at once, and so many a second permanently.
BURST, PER_SECOND = 20.0, 0.25
#: Period of the summaries: at first, and at most.
FIRST_NS, SELDOM_NS = 10_000_000_000, 60_000_000_000
#: A flood ends after a period with no more events than this.
CALM = 2
#: Kinds that are always passed: a person's actions, and the state, which follows from all others.
NEVER_GROUPED = frozenset({"button", "state"})


@dataclass
class _Flood:
    since_ns: int
    window_ns: int = FIRST_NS
    count: int = 0
    last: Event | None = None


class EventGroups:
    """The event groups of one daemon.

    Call `pass_on` for each event, and `take_due_events` on a tick.
    """

    def __init__(self) -> None:
        self._allowed: dict[str, tuple[float, int]] = {}  # kind → allowed events, at an instant
        self._floods: dict[str, _Flood] = {}

    def pass_on(self, event: Event, now_ns: int) -> bool:
        """Return whether *event* is reported singly; else a later summary counts it."""
        kind = event.kind
        if kind in NEVER_GROUPED:
            return True
        if flood := self._floods.get(kind):
            flood.count += 1
            flood.last = event
            return False
        allowed, since_ns = self._allowed.get(kind, (BURST, now_ns))
        allowed = min(BURST, allowed + (now_ns - since_ns) * 1e-9 * PER_SECOND)
        if allowed >= 1.0:
            self._allowed[kind] = allowed - 1.0, now_ns
            return True
        self._floods[kind] = _Flood(now_ns, count=1, last=event)
        return False

    def take_due_events(self, now_ns: int) -> list[Event]:
        """Return the summaries of floods that are due."""
        events = []
        for kind, flood in list(self._floods.items()):
            waited_ns = now_ns - flood.since_ns
            if waited_ns < flood.window_ns:
                continue
            if flood.last is not None:
                events.append(_summarise(flood.last, flood.count, waited_ns))
            if flood.count <= CALM:
                del self._floods[kind]
                self._allowed[kind] = BURST, now_ns
            else:
                self._floods[kind] = _Flood(now_ns, min(2 * flood.window_ns, SELDOM_NS))
        return events


def _summarise(last: Event, count: int, waited_ns: int) -> Event:
    seconds = waited_ns * 1e-9
    text = f"{count} more {last.kind} events in {seconds:.0f} s, the last: {last.text}"
    detail = {"grouped": count, "seconds": round(seconds, 1), "last": last.detail}
    return replace(last, text=text, detail=detail)

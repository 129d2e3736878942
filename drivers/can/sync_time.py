"""When the encoders latched: the instant of each SYNC on the host's clock."""

from __future__ import annotations

from collections import deque

WINDOW = 256  # SYNCs over which the shortest way out and back is taken
LOST_NS = 100_000_000  # an own SYNC that has not come back by then, while others were sent, is lost
ECHO_PATIENCE = 16  # own SYNCs sent before we conclude that this interface does not return them


class SyncTime:
    """Own SYNCs are sent at one instant and received at a later one; the shortest difference is
    the way, the rest is somebody being late. A foreign SYNC has only its arrival."""

    def __init__(self) -> None:
        self.echo: bool | None = None  # does the interface return our own SYNC?
        self.foreign = 0  # SYNCs received that, while we send ours, are not ours
        self._sent: deque[int] = deque()
        self._echo_delays_ns: deque[int] = deque(maxlen=WINDOW)
        self._unanswered = 0

    def sent(self, now_ns: int) -> bool:
        """Own SYNC on its way. True if, without an echo, this is all we shall know of it."""
        if self.echo is None:
            self._unanswered += 1
            if self._unanswered > ECHO_PATIENCE:
                self.echo = False
                self._sent.clear()
        if self.echo is False:
            return True
        self._sent.append(now_ns)
        return False

    def received(self, now_ns: int) -> tuple[int, int]:
        """A SYNC from the bus: its instant, and how many own ones before it were lost."""
        lost = 0
        # All but the last are looked at: what came back of that may have waited for us to read it.
        while len(self._sent) > 1 and now_ns - self._sent[0] > LOST_NS:
            self._sent.popleft()
            lost += 1
        if not self._sent:
            self.foreign += self.echo is not None
            return now_ns, lost
        self.echo = True
        sent_ns = self._sent.popleft()
        self._echo_delays_ns.append(now_ns - sent_ns)
        return sent_ns + min(self._echo_delays_ns), lost

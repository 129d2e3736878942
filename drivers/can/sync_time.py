"""Estimates when the encoders latched: the instant of each SYNC on the host's clock."""

from __future__ import annotations

from collections import deque

WINDOW = 256  # number of SYNCs over which the shortest echo delay is taken
LOST_NS = 100_000_000  # an own SYNC not returned by then, while others were sent, is lost
ECHO_PATIENCE = 16  # number of own SYNCs without echo that shows that there is none


class SyncTime:
    """The delay of own SYNCs from sending to reception.

    The shortest delay is the transmission; the rest is lateness of the host. A foreign SYNC has
    only its arrival.
    """

    def __init__(self) -> None:
        self.echo: bool | None = None  # whether the interface returns our own SYNC; None: not known
        self.foreign = 0  # foreign SYNCs received while we send our own
        self._sent: deque[int] = deque()
        self._echo_delays_ns: deque[int] = deque(maxlen=WINDOW)
        self._unanswered = 0

    def sent(self, now_ns: int) -> bool:
        """Record an own SYNC; return True if no echo will come, so that *now_ns* is its instant."""
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
        """Record a SYNC from the bus; return its instant and how many own ones were lost before."""
        lost = 0
        # The last one is not checked: its echo may have waited for us to read it.
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

"""What every page is told, kept once for all of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

#: Measurements and events that a page has when it is opened; the daemon keeps as many of each.
KEPT = 2000
#: Sent to one page at once, so that a page which does not read holds no more than this.
MOST_BYTES = 1 << 16


class Board:
    """Messages by topic: of some the latest alone, of others every one.

    A page is no more than the version it has read up to: it has no queue that could grow. Who reads
    late finds the latest of each topic, and of those that are kept whole, what he has missed.
    """

    def __init__(self) -> None:
        self.version = 0
        self._latest: dict[str, tuple[int, bytes]] = {}
        self._every: deque[tuple[int, bytes]] = deque(maxlen=KEPT)

    def put(self, topic: str, data: str) -> None:
        """The latest of *topic*, in place of the one before; *data* is JSON in one line."""
        self.version += 1
        self._latest[topic] = self.version, format_message(topic, data)

    def append(self, topic: str, data: str) -> None:
        """One more of *topic*, none of which is left out."""
        self.version += 1
        self._every.append((self.version, format_message(topic, data)))

    def since(self, version: int) -> tuple[bytes, int]:
        """What was said after *version*, the oldest first, and the version read up to then; at
        most about `MOST_BYTES`, the rest with the next call."""
        if version >= self.version:
            return b"", version
        waiting = [entry for entry in self._latest.values() if entry[0] > version]
        waiting += self._missed(version)
        waiting.sort()
        message = bytearray()
        for number, data in waiting:
            message += data
            version = number
            if len(message) >= MOST_BYTES:
                break
        return bytes(message), version

    def _missed(self, version: int) -> Iterator[tuple[int, bytes]]:
        for entry in reversed(self._every):
            if entry[0] <= version:
                return
            yield entry


def format_message(topic: str, data: str) -> bytes:
    """As Server-Sent Events have it."""
    return f"event: {topic}\ndata: {data}\n\n".encode()

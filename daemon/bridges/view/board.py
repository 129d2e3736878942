"""The messages for the pages, kept once for all of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

#: Measurements and events that a new page gets; the daemon keeps as many of each.
KEPT = 2000
#: Limit of the data sent to one page at once, so that a page that does not read holds no more.
MOST_BYTES = 1 << 16


class Board:
    """Messages by topic: only the latest of some topics, every one of others.

    For each page only the version that it has read is stored, so there is no queue that could grow.
    A page that reads late gets the latest message of each topic, and all missed ones of the topics
    that are kept whole.
    """

    def __init__(self) -> None:
        self.version = 0
        self._latest: dict[str, tuple[int, bytes]] = {}
        self._every: deque[tuple[int, bytes]] = deque(maxlen=KEPT)

    def put(self, topic: str, data: str) -> None:
        """Replace the latest message of *topic*; *data* is JSON in one line."""
        self.version += 1
        self._latest[topic] = self.version, format_message(topic, data)

    def append(self, topic: str, data: str) -> None:
        """Add a message of a topic of which every message is kept."""
        self.version += 1
        self._every.append((self.version, format_message(topic, data)))

    def since(self, version: int) -> tuple[bytes, int]:
        """Return the messages after *version*, the oldest first, and the version reached.

        They have at most about `MOST_BYTES`; the next call returns the rest.
        """
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
    """Format a message for Server-Sent Events."""
    return f"event: {topic}\ndata: {data}\n\n".encode()

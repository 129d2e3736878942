"""Answer queries over Zenoh: info, health, the past of the streams, commands.

Every client with read access may query as often as it likes. Threads beside the stream answer
queries that only read, at a limited rate. Queries that the measuring thread must answer wait for
its tick, a few at a time. Queries wait in Zenoh's rings; of more than a ring holds, the oldest are
dropped there and end without an answer. The query decides whether a reply waits for its reader:
Zenoh 1.10 ignores our setting.
"""

from __future__ import annotations

import base64
import json
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress

import zenoh
from zenoh import handlers

from armd import keys
from armd.daemon.live.answer import Respond
from armd.daemon.network.publisher import JSON, KeptStream, Publisher
from armd.daemon.unexpected import Unexpected
from armd.drivers.replay import raw
from armd.drivers.sample import RawFrame

QueryHandler = Callable[[zenoh.Parameters, Respond], None]
"""Begins one command with its parameters, and answers when it is done or refused."""

#: Queries of one kind that may wait for their answer.
RING = 32
#: Queries of one kind that are answered in one pass of a thread, or on a tick of the daemon.
AT_ONCE = 4
LOOK_S = 0.02
#: Longest time between two passes without queries: each pass costs as much as some samples.
IDLE_LOOK_S = 0.1
#: An answering thread pauses for so many times its work, so that the stream has the processor.
REST = 4.0
#: Replies of one answer that are sent without a pause, so that a reader can keep up.
BURST, PAUSE_S = 50, 0.005

_Tell = Callable[[zenoh.Query], None]
_Queryable = zenoh.Queryable[handlers.Handler[zenoh.Query]]


class Queries:
    """The queryables of one arm; the measuring thread calls `answer`."""

    def __init__(
        self,
        session: zenoh.Session,
        serial: str,
        publisher: Publisher,
        texts_by_key: Mapping[str, Callable[[], str]],
        preamble: Callable[[], list[RawFrame]],
        commands: Mapping[str, QueryHandler] | None,
        unexpected: Unexpected,
    ) -> None:
        """Declare the queryables.

        *texts_by_key* maps a key to the function of its answer, called in another thread.
        *commands* None: every command is refused.
        """
        self._publisher = publisher
        self._unexpected = unexpected
        self._preamble = preamble
        self._commands = commands
        self._command_prefix = keys.key(serial, keys.COMMAND) + "/"
        self._raw_key = keys.key(serial, keys.RAW)
        texts_by_key = {**texts_by_key, keys.HEALTH: publisher.health_text}
        texts = {keys.key(serial, topic_key): text for topic_key, text in texts_by_key.items()}
        streams = (publisher.measurements, publisher.events)
        self._declared = [
            _declare(session, self._raw_key, self._tell_preamble),
            _declare(session, self._command_prefix + "**", self._obey),
        ]
        self._tellers = [
            _Teller(queryables, unexpected)
            for queryables in (
                [_declare(session, key, _tell(key, text)) for key, text in texts.items()],
                [_declare(session, stream.key, _tell_past(stream)) for stream in streams],
            )
        ]

    def answer(self) -> None:
        """Answer a few of the queries that only the measuring thread can answer."""
        _answer_some(self._declared, self._unexpected)

    def close(self) -> None:
        for teller in self._tellers:
            teller.stop()

    def _tell_preamble(self, query: zenoh.Query) -> None:
        """Send a recorder the frames that belong before the next raw frame."""
        following = self._publisher.next_raw_frame
        payloads = [raw.pack(following, frame) for frame in self._preamble()]
        encoded = [base64.b64encode(payload).decode() for payload in payloads]
        with query:
            _reply(query, self._raw_key, json.dumps({"next": following, "frames": encoded}))

    def _obey(self, query: zenoh.Query) -> None:
        key = str(query.key_expr)

        def answer(text: str, done: bool) -> None:
            with query:
                if done:
                    _reply(query, key, json.dumps({"done": text}))
                else:
                    query.reply_err(text)

        if self._commands is None:
            answer("refused: commands are not enabled ([commands] enabled)", False)
            return
        command = self._commands.get(key.removeprefix(self._command_prefix))
        if command is None:
            answer(f"no such command; there are: {', '.join(self._commands)}", False)
            return
        command(query.parameters, answer)


class _Teller:
    """A thread that answers queries which only read."""

    def __init__(
        self, queryables: Iterable[tuple[_Queryable, _Tell]], unexpected: Unexpected
    ) -> None:
        self._queryables = list(queryables)
        self._unexpected = unexpected
        self._stopped = threading.Event()
        threading.Thread(target=self._run, name="teller", daemon=True).start()

    def stop(self) -> None:
        self._stopped.set()

    def _run(self) -> None:
        pause_s = LOOK_S
        while not self._stopped.wait(pause_s):
            began_s = time.thread_time()
            if _answer_some(self._queryables, self._unexpected):
                pause_s = max(LOOK_S, REST * (time.thread_time() - began_s))
            else:
                pause_s = min(2 * max(LOOK_S, pause_s), IDLE_LOOK_S)


def _declare(session: zenoh.Session, key: str, tell: _Tell) -> tuple[_Queryable, _Tell]:
    return session.declare_queryable(key, handlers.RingChannel(RING)), tell


def _answer_some(queryables: Iterable[tuple[_Queryable, _Tell]], unexpected: Unexpected) -> bool:
    """Answer some queries; return whether there were any.

    A query that cannot be answered does not prevent the answers to others.
    """
    is_asked = False
    for queryable, tell in queryables:
        for _ in range(AT_ONCE):
            with unexpected.survive("questions"), suppress(zenoh.ZError):
                # ZError: the client is gone, or the session is closed
                query = queryable.try_recv()
                if query is None:
                    break
                is_asked = True
                tell(query)
    return is_asked


def _reply(
    query: zenoh.Query,
    key: str,
    text: str | zenoh.ZBytes,
    timestamp: zenoh.Timestamp | None = None,
) -> None:
    query.reply(key, text, encoding=JSON, timestamp=timestamp)


def _tell(key: str, text: Callable[[], str]) -> _Tell:
    def tell(query: zenoh.Query) -> None:
        with query:
            _reply(query, key, text())

    return tell


def _tell_past(stream: KeptStream) -> _Tell:
    def tell(query: zenoh.Query) -> None:
        with query:
            for i, (payload, timestamp) in enumerate(list(stream.past), 1):
                _reply(query, stream.key, payload, timestamp)
                if i % BURST == 0:
                    time.sleep(PAUSE_S)

    return tell

"""The questions the daemon answers over Zenoh: info, health, the past of its streams, commands.

Whoever may look may ask, as often as he likes: what only tells is told by threads beside the
stream, at their own pace, and what the measuring thread must answer itself waits for its tick, a
few at a time. Questions wait in rings of Zenoh's; of more than a ring holds the oldest are dropped
there, which ends them without an answer. Whether a reply waits for its reader is for the question
to say: Zenoh 1.10 takes no word of ours on it.
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

#: Questions of one kind that wait for their answer.
RING = 32
#: Of one kind, answered at once: in a look of a thread, or on a tick of the daemon.
AT_ONCE = 4
LOOK_S = 0.02
#: So long at most between two looks while nobody asks: each costs as much as some samples.
IDLE_LOOK_S = 0.1
#: A thread that answers rests so many times as long as it worked: the stream has the processor.
REST = 4.0
#: Replies of one answer that leave without a pause, so that a reader keeps up with them.
BURST, PAUSE_S = 50, 0.005

_Tell = Callable[[zenoh.Query], None]
_Queryable = zenoh.Queryable[handlers.Handler[zenoh.Query]]


class Queries:
    """Declares the queryables of one arm; `answer` is called by the measuring thread."""

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
        """*texts_by_key*: by key, what is asked for in another thread; *commands* None: every
        command is refused."""
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
        """Answer a few of the questions that only the measuring thread can answer."""
        _answer_some(self._declared, self._unexpected)

    def close(self) -> None:
        for teller in self._tellers:
            teller.stop()

    def _tell_preamble(self, query: zenoh.Query) -> None:
        """For a recorder: what stands before the next raw frame."""
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
    """A thread that answers questions which everybody may ask."""

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
    """Whether anybody asked. One question that cannot be answered does not keep the others from
    their answers."""
    is_asked = False
    for queryable, tell in queryables:
        for _ in range(AT_ONCE):
            with unexpected.survive("questions"), suppress(zenoh.ZError):
                # ZError: whoever asked is gone, or the session is closed
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

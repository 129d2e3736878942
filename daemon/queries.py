"""The questions the daemon answers over Zenoh: info, the past of its streams, commands.

Queries wait in Zenoh's channels until the daemon's one thread calls `answer`, so no Zenoh call is
ever made inside a Zenoh callback.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from typing import Any

import zenoh

from armd import keys
from armd.daemon.publisher import JSON, Kept, Publisher
from armd.drivers import raw
from armd.drivers.sample import RawFrame
from armd.errors import ArmdError

Command = Callable[[zenoh.Parameters], str]
"""Does one command with its parameters; returns what was done, raises `ArmdError` if it was not."""

_Answer = Callable[[zenoh.Query], None]
_Queryable = zenoh.Queryable[zenoh.Handler[zenoh.Query]]


class Queries:
    """Declares the queryables of one arm and answers them."""

    def __init__(
        self,
        session: zenoh.Session,
        serial: str,
        publisher: Publisher,
        info: Callable[[], dict[str, Any]],
        preamble: Callable[[], list[RawFrame]],
        commands: Mapping[str, Command] | None,
    ) -> None:
        """*commands* None: every command is refused."""
        self._publisher = publisher
        self._info = info
        self._preamble = preamble
        self._commands = commands
        self._command_prefix = keys.key(serial, keys.COMMAND) + "/"
        self._info_key = keys.key(serial, keys.INFO)
        self._raw_key = keys.key(serial, keys.RAW)
        self._health_key = keys.key(serial, keys.HEALTH)
        answers: dict[str, _Answer] = {
            self._info_key: self._tell_info,
            self._health_key: self._tell_health,
            self._raw_key: self._tell_preamble,
            publisher.measurements.key: _tell_past(publisher.measurements),
            publisher.events.key: _tell_past(publisher.events),
            self._command_prefix + "**": self._obey,
        }
        self._queryables: list[tuple[_Queryable, _Answer]] = [
            (session.declare_queryable(key), answer) for key, answer in answers.items()
        ]

    def answer(self) -> None:
        """Answer every query that waits."""
        for queryable, tell in self._queryables:
            while (query := queryable.try_recv()) is not None:
                with query:
                    tell(query)

    def _tell_info(self, query: zenoh.Query) -> None:
        query.reply(self._info_key, json.dumps(self._info()), encoding=JSON)

    def _tell_health(self, query: zenoh.Query) -> None:
        query.reply(self._health_key, json.dumps(self._publisher.health), encoding=JSON)

    def _tell_preamble(self, query: zenoh.Query) -> None:
        """For a recorder: what stands before the next raw frame."""
        following = self._publisher.next_raw_frame
        payloads = [raw.pack(following, frame) for frame in self._preamble()]
        encoded = [base64.b64encode(payload).decode() for payload in payloads]
        query.reply(
            self._raw_key, json.dumps({"next": following, "frames": encoded}), encoding=JSON
        )

    def _obey(self, query: zenoh.Query) -> None:
        if self._commands is None:
            query.reply_err("refused: commands are not enabled ([commands] enabled)")
            return
        key = str(query.key_expr)
        command = self._commands.get(key.removeprefix(self._command_prefix))
        if command is None:
            query.reply_err(f"no such command; there are: {', '.join(self._commands)}")
            return
        try:
            done = command(query.parameters)
        except ArmdError as error:
            query.reply_err(str(error))
        else:
            query.reply(key, json.dumps({"done": done}), encoding=JSON)


def _tell_past(stream: Kept) -> _Answer:
    def tell(query: zenoh.Query) -> None:
        for text, timestamp in stream.past:
            query.reply(stream.key, text, encoding=JSON, timestamp=timestamp)

    return tell

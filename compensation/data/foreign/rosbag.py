"""Reads `sensor_msgs/JointState` of a ROS 2 bag (MCAP or SQLite) as a table, a row a message.

A message is CDR (OMG DDS-XTypes 1.3, 7.4.3): four bytes that state the byte order, then each number
at a multiple of its size.
"""

from __future__ import annotations

import math
import sqlite3
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from armd.compensation.data.foreign.table import ForeignTable, has_file
from armd.errors import BadInput
from armd.files.inputs import check_input
from armd.terminal.suggest import format_names

KIND = "sensor_msgs/msg/JointState"
SUFFIXES = (".mcap", ".db3")
#: Errors that a damaged length causes.
_TOO_LONG = (MemoryError, OverflowError)


class RawMessage(NamedTuple):
    """A message as it was recorded."""

    topic: str
    data: bytes


@dataclass(frozen=True)
class JointState:
    """The joint angles at one instant."""

    stamp_ns: int
    angle_rad: dict[str, float]


def is_bag(path: Path) -> bool:
    """Return whether *path* is a bag's file or folder."""
    return path.suffix.lower() in SUFFIXES or has_file(path, "metadata.yaml")


def read_bag(path: Path) -> ForeignTable:
    """Read all joint states of the one topic that has them; raises `BadInput`."""
    files = [path]
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in SUFFIXES)
        if not files:
            raise BadInput(path, "the folder", "no .mcap and no .db3", "a ROS 2 bag")
    messages = [message for file in files for message in _messages(file)]
    topics = Counter(message.topic for message in messages)
    if len(topics) != 1:
        actual = format_names(topics) if topics else f"no {KIND}"
        raise BadInput(path, "the topics", actual, f"one topic of {KIND}")
    states = []
    for number, message in enumerate(messages, 1):
        try:
            states.append(_parse(message.data))
        except (struct.error, UnicodeDecodeError, ValueError) as error:
            location = f"message {number} of {message.topic}"
            raise BadInput(path, location, f"bytes that are none ({error})", KIND) from error
    names = list(dict.fromkeys(name for state in states for name in state.angle_rad))
    header = ["time [ns]", *(f"{name} [rad]" for name in names)]
    rows = [
        [str(state.stamp_ns), *(repr(state.angle_rad.get(name, math.nan)) for name in names)]
        for state in sorted(states, key=lambda state: state.stamp_ns)
    ]
    remark = f"{len(rows)} messages of {next(iter(topics))}, a {KIND}; names: {format_names(names)}"
    return ForeignTable(path, header, rows, [remark])


def _messages(file: Path) -> Iterator[RawMessage]:
    check_input(file)
    yield from (_of_mcap if file.suffix.lower() == ".mcap" else _of_sqlite)(file)


def _of_mcap(file: Path) -> Iterator[RawMessage]:
    from mcap.exceptions import McapError
    from mcap.reader import NonSeekingReader

    try:
        with file.open("rb") as stream:
            for schema, channel, message in NonSeekingReader(
                stream, validate_crcs=True
            ).iter_messages():
                if schema is not None and schema.name == KIND:
                    if channel.message_encoding != "cdr":
                        actual = f"messages in {channel.message_encoding!r}"
                        raise BadInput(file, channel.topic, actual, "cdr")
                    yield RawMessage(channel.topic, message.data)
    except (McapError, OSError, ValueError, RuntimeError, struct.error, *_TOO_LONG) as error:
        raise BadInput(
            file, "the file", f"no whole MCAP ({error})", "one of a ROS 2 bag"
        ) from error


def _of_sqlite(file: Path) -> Iterator[RawMessage]:
    query = (
        "SELECT topics.name, messages.data FROM messages JOIN topics ON"
        " messages.topic_id = topics.id WHERE topics.type = ? AND"
        " topics.serialization_format = 'cdr' ORDER BY messages.timestamp"
    )
    connection = sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)
    try:
        for topic, data in connection.execute(query, (KIND,)):
            if not isinstance(data, bytes):
                raise BadInput(file, "messages.data", type(data).__name__, "bytes")
            yield RawMessage(str(topic), data)
    except (sqlite3.Error, ValueError, *_TOO_LONG) as error:
        raise BadInput(file, "the file", f"no bag of ROS 2 ({error})", "tables of one") from error
    finally:
        connection.close()


def _parse(data: bytes) -> JointState:
    """Parse header, names and positions; raises `ValueError` or `struct.error`."""
    cursor = _Cursor(data)
    seconds, nanoseconds = cursor.number("i", 4), cursor.number("I", 4)
    cursor.text()  # frame_id
    names = [cursor.text() for _ in range(cursor.count(4))]
    positions = [cursor.number("d", 8) for _ in range(cursor.count(8))]
    if len(positions) != len(names) or len(set(names)) != len(names):
        raise ValueError(f"{len(names)} names and {len(positions)} positions")
    stamp_ns = int(seconds) * 10**9 + int(nanoseconds)
    return JointState(stamp_ns, dict(zip(names, positions, strict=True)))


class _Cursor:
    """A reading position, counted from after the four bytes of the encapsulation."""

    def __init__(self, data: bytes) -> None:
        if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
            raise ValueError("not plain CDR")
        self._order = "<" if data[1] else ">"
        self._data, self._offset = data[4:], 0

    def number(self, kind: str, size: int) -> float:
        """Read one number at a multiple of its *size*."""
        self._offset += -self._offset % size
        (value,) = struct.unpack_from(self._order + kind, self._data, self._offset)
        self._offset += size
        return float(value) if kind == "d" else int(value)

    def count(self, size: int) -> int:
        """Read the length of a sequence of items of at least *size* bytes; raises `ValueError` if
        too long.
        """
        length = int(self.number("I", 4))
        if length * size > len(self._data) - self._offset + 8:
            raise ValueError(f"a sequence of {length}")
        return length

    def text(self) -> str:
        """Read a string, which ends with a zero byte."""
        length = self.count(1)
        raw = self._data[self._offset : self._offset + length]
        self._offset += length
        return raw.removesuffix(b"\0").decode()

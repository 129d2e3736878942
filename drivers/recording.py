"""A recording (MCAP) as a driver needs it: the raw frames in their order, and what they came from.

`armd record` writes it (docs/recording.md has the layout). A recorder that was killed leaves a
file without an end; whatever stands before that is read.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.exceptions import InvalidMagic
from mcap.records import Attachment, Channel, Message
from mcap.stream_reader import StreamReader

from armd.drivers import raw
from armd.drivers.sample import RawFrame
from armd.errors import BadInput

RAW_TOPIC = "/raw"
PREAMBLE_TOPIC = "/preamble"
INFO_ATTACHMENT = "info.json"  # the daemon's answer to the info key when recording began
CALIBRATION_ATTACHMENT = "calibration.json"  # the very file, byte by byte


@dataclass(frozen=True, slots=True)
class Recorded:
    """One message of a recording."""

    topic: str
    data: bytes


class Recording:
    """Raises `BadInput` for a file that is no recording of armd's."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.attachments: dict[str, bytes] = {}
        for record in self._records():
            if isinstance(record, Attachment):
                self.attachments.setdefault(record.name, record.data)
            elif isinstance(record, Message):
                break  # attachments stand first
        if INFO_ATTACHMENT not in self.attachments:
            raise BadInput(path, "attachments", "no info.json", "a file of `armd record`")
        self.info: dict[str, Any] = json.loads(self.attachments[INFO_ATTACHMENT])

    def preamble(self) -> list[RawFrame]:
        """What a decoder must be fed first (`Driver.preamble`), of a recording that was begun
        while the arm was connected; otherwise empty."""
        frames = []
        for message in self.messages({PREAMBLE_TOPIC, RAW_TOPIC}):
            if message.topic == RAW_TOPIC:
                break
            frames.append(raw.unpack(message.data)[1])
        return frames

    def frames(self) -> Iterator[RawFrame]:
        """The raw frames as the daemon fed them to its decoder; raises `BadInput` where the
        recorder has lost some, because nothing after them would be what it was."""
        expected: int | None = None
        for message in self.messages({RAW_TOPIC}):
            number, frame = raw.unpack(message.data)
            if expected is not None and number != expected:
                raise BadInput(self.path, f"raw frame {expected}", f"{number}", "no gap")
            expected = number + 1
            yield frame

    def messages(self, topics: set[str] | None = None) -> Iterator[Recorded]:
        """All messages, or those of *topics*, in the order of the file."""
        names: dict[int, str] = {}
        for record in self._records():
            if isinstance(record, Channel):
                names[record.id] = record.topic
            elif isinstance(record, Message):
                topic = names[record.channel_id]
                if topics is None or topic in topics:
                    yield Recorded(topic, record.data)

    def _records(self) -> Iterator[Any]:
        try:
            with self.path.open("rb") as file:
                yield from StreamReader(file).records
        except FileNotFoundError as error:
            raise BadInput(self.path, "the file", "nothing", "a recording (.mcap)") from error
        except InvalidMagic as error:
            raise BadInput(self.path, "the file", str(error), "a recording (.mcap)") from error
        except BadInput:
            raise
        except Exception:  # the mcap library meets a cut file with whatever it trips over
            return

"""A recording (MCAP) for a driver: the raw frames in order, and the recorded configuration.

`armd record` writes it (docs/how-to/record-export.md has the layout). A recorder that was killed
leaves a file without an end. The part before that is read, and a message reports the rest as
missing.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mcap.records import Attachment

from armd.drivers.replay import raw
from armd.drivers.replay.mcap_file import McapFile, Recorded
from armd.drivers.sample import RawFrame
from armd.errors import BadInput
from armd.files.schema import load_json_data

RAW_TOPIC = "/raw"
PREAMBLE_TOPIC = "/preamble"
INFO_ATTACHMENT = "info.json"  # the daemon's answer to the info key at the start of the recording
CALIBRATION_ATTACHMENT = "calibration.json"  # the file itself, byte by byte


class Recording:
    """A recording, which is read once to its end when it is opened.

    Raises `BadInput` for a damaged file, or one that `armd record` did not write. `missing`
    describes the missing part of a recording without an end.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.attachments: dict[str, bytes] = {}
        file = McapFile(path)
        for part in file.parts():
            if isinstance(part, Attachment):
                self.attachments.setdefault(part.name, part.data)
        if INFO_ATTACHMENT not in self.attachments:
            raise BadInput(path, "attachments", "no info.json", "a file of `armd record`")
        self.info: dict[str, Any] = self._checked_info()
        self.missing = None if file.cut is None else self._ends_early(file)

    @property
    def driver(self) -> dict[str, Any]:
        """The table `[driver]` of the recorded daemon."""
        driver: dict[str, Any] = self.info["configuration"]["driver"]
        return driver

    def preamble(self) -> list[RawFrame]:
        """Return the frames that a decoder needs first (`Driver.preamble`).

        Empty if the arm was not connected when the recording began.
        """
        frames = []
        for message in self.messages({PREAMBLE_TOPIC, RAW_TOPIC}):
            if message.topic == RAW_TOPIC:
                break
            frames.append(self._frame(message)[1])
        return frames

    def frames(self) -> Iterator[RawFrame]:
        """Yield the raw frames as the daemon fed them to its decoder.

        Raises `BadInput` where the recorder lost frames: a decoder's state after them would be
        another one.
        """
        expected: int | None = None
        for message in self.messages({RAW_TOPIC}):
            number, frame = self._frame(message)
            if expected is not None and number != expected:
                raise BadInput(self.path, f"raw frame {expected}", f"{number}", "no gap")
            expected = number + 1
            yield frame

    def messages(self, topics: set[str] | None = None) -> Iterator[Recorded]:
        """Yield all messages, or those of *topics*, in the order of the file."""
        for message in McapFile(self.path).messages():
            if topics is None or message.topic in topics:
                yield message

    def _frame(self, message: Recorded) -> tuple[int, RawFrame]:
        try:
            return raw.unpack(message.data)
        except ValueError as error:
            raise BadInput(self.path, message.topic, str(error), "a raw frame") from error

    def _checked_info(self) -> dict[str, Any]:
        location = f"{self.path}: {INFO_ATTACHMENT}"
        info = load_json_data(location, self.attachments[INFO_ATTACHMENT])
        for keys in (("arm",), ("configuration", "driver", "kind")):
            value = info
            for key in keys:
                value = value.get(key) if isinstance(value, dict) else None
            if value is None:
                raise BadInput(
                    location, ".".join(keys), "nothing", "what `armd record` writes there"
                )
        assert isinstance(info, dict)
        return info

    def _ends_early(self, file: McapFile) -> str:
        n, last_ns = 0, 0
        for message in self.messages({RAW_TOPIC}):
            n, last_ns = n + 1, message.unix_ns
        until = _instant(last_ns)
        frames_text = f"{n} raw frames, until {until}" if n else "no raw frame"
        missing = "the index" if file.only_index_cut else "what came after"
        return (
            f"{self.path}: byte {file.cut}: found no end, as of a recorder that was killed or a "
            f"file that was cut; {frames_text}, are whole, {missing} is missing"
        )


def _instant(unix_ns: int) -> str:
    """Return the instant as text; a frame may carry a time that no calendar has."""
    try:
        return datetime.fromtimestamp(unix_ns / 1e9, UTC).isoformat(timespec="milliseconds")
    except (OverflowError, ValueError, OSError):
        return f"{unix_ns} ns"

"""Record a daemon's messages in an MCAP file: raw frames, points, events and others.

docs/how-to/record-export.md describes the file. A killed recorder leaves a file that can be read up
to the last fraction of a second.
"""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt
from mcap.writer import Writer

from armd import POINT, __version__, keys
from armd.drivers.replay import raw
from armd.drivers.replay.recording import (
    CALIBRATION_ATTACHMENT,
    INFO_ATTACHMENT,
    PREAMBLE_TOPIC,
    RAW_TOPIC,
)
from armd.errors import ArmdError

CHUNK_BYTES = 1 << 16  # what a killed recorder may lose
RAW_ENCODING = "armd.raw.v1"
TOPICS = {keys.POINT: "/point", keys.EVENT: "/event", keys.HEALTH: "/health"} | {
    keys.MEASUREMENT: "/measurement"
}
_NUMBERS = {"x": {"type": "number"}, "y": {"type": "number"}, "z": {"type": "number"}}
#: JSON schemas, so that Foxglove plots every field; those of other messages list no fields.
SCHEMAS: dict[str, dict[str, Any]] = {
    keys.POINT: {
        "type": "object",
        "properties": {
            "seq": {"type": "integer"},
            "stamp_ns": {"type": "integer"},
            "monotonic_ns": {"type": "integer"},
            "position_mm": {"type": "object", "properties": _NUMBERS},
            "orientation": {
                "type": "object",
                "properties": _NUMBERS | {"w": {"type": "number"}},
            },
            "covariance_mm2": {"type": "array", "items": {"type": "number"}},
            "correction_mm": {"type": "object", "properties": _NUMBERS},
            "flags": {"type": "integer"},
            "calibration": {"type": "integer"},
            "buttons": {"type": "integer"},
        },
    },
    **{topic_key: {"type": "object"} for topic_key in (keys.EVENT, keys.HEALTH, keys.MEASUREMENT)},
}


class Recorder:
    """Writes to an open binary file; `close` finishes the file."""

    def __init__(self, file: IO[bytes], info: dict[str, Any], calibration: str | None) -> None:
        """Start a file with *info* and *calibration* file of the recorded arm attached."""
        self.counts = dict.fromkeys([keys.RAW, *TOPICS], 0)
        self.lost_frames = 0
        self.malformed = 0
        self._next_frame = 0
        self._writer = Writer(file, chunk_size=CHUNK_BYTES, enable_data_crcs=True)
        self._writer.start(profile="armd", library=f"armd {__version__}")
        now_ns = time.time_ns()
        self._attach(INFO_ATTACHMENT, json.dumps(info, indent=1), now_ns)
        if calibration is not None:
            self._attach(CALIBRATION_ATTACHMENT, calibration, now_ns)
        self._raw = self._writer.register_channel(RAW_TOPIC, RAW_ENCODING, schema_id=0)
        self._channels = {
            topic_key: self._writer.register_channel(topic, "json", self._schema(topic_key))
            for topic_key, topic in TOPICS.items()
        }

    def close(self) -> None:
        self._writer.finish()

    def begin(self, following: int, preamble: list[bytes]) -> None:
        """Write *preamble*, the payloads that belong before raw frame number *following*.

        Raises `ArmdError` for a payload that is not a raw frame.
        """
        channel = self._writer.register_channel(PREAMBLE_TOPIC, RAW_ENCODING, schema_id=0)
        for payload in preamble:
            try:
                unix_ns = raw.unpack(payload)[1].unix_ns
            except ValueError as error:
                raise ArmdError(f"the daemon's preamble holds no raw frame: {error}") from error
            self._writer.add_message(channel, unix_ns, payload, unix_ns)
        self._next_frame = following

    def take_frames(self, payloads: list[bytes]) -> None:
        """Record payloads of the raw key, as published."""
        for payload in payloads:
            try:
                number, frame = raw.unpack(payload)
            except ValueError:  # not armd's
                self.malformed += 1
                continue
            if number < self._next_frame:  # the preamble replaces it
                continue
            self.lost_frames += number - self._next_frame
            self._next_frame = number + 1
            self._add(keys.RAW, self._raw, payload, frame.unix_ns)

    def take_points(self, payloads: list[bytes]) -> None:
        """Record payloads of the point key, as published."""
        points = np.frombuffer(b"".join(payloads), POINT)
        for point, data in zip(points, as_json(points), strict=True):
            self._add(keys.POINT, self._channels[keys.POINT], data, int(point["stamp_ns"]))

    def take_messages(self, topic_key: str, payloads: list[bytes]) -> None:
        """Record payloads of a JSON key, as published."""
        for payload in payloads:
            self._add(topic_key, self._channels[topic_key], payload, time.time_ns())

    def _schema(self, topic_key: str) -> int:
        schema = json.dumps(SCHEMAS[topic_key]).encode()
        return int(self._writer.register_schema(f"armd.{topic_key}", "jsonschema", schema))

    def _attach(self, name: str, text: str, now_ns: int) -> None:
        self._writer.add_attachment(now_ns, now_ns, name, "application/json", text.encode())

    def _add(self, topic_key: str, channel: int, data: bytes, unix_ns: int) -> None:
        sequence = self.counts[topic_key] & 0xFFFFFFFF
        self._writer.add_message(channel, max(0, unix_ns), data, max(0, unix_ns), sequence)
        self.counts[topic_key] += 1


def as_json(points: npt.NDArray[np.void]) -> list[bytes]:
    """Return each of *points* (n,) of `POINT` as JSON, without loss.

    Every number has the shortest text that gives the same number; NaN is null.
    """
    columns = {name: points[name].tolist() for name in POINT.names or () if name != "reserved"}
    axes = {"position_mm": "xyz", "orientation": "xyzw", "correction_mm": "xyz"}
    for name, letters in axes.items():
        columns[name] = [
            dict(zip(letters, map(_to_number, row), strict=True)) for row in columns[name]
        ]
    columns["covariance_mm2"] = [list(map(_to_number, row)) for row in columns["covariance_mm2"]]
    return [
        json.dumps(dict(zip(columns, row, strict=True))).encode()
        for row in zip(*columns.values(), strict=True)
    ]


def _to_number(value: float) -> float | None:
    return None if math.isnan(value) else value


def choose_default_path(serial: str) -> Path:
    """Return `SERIAL-20260301T090000.mcap` in the current folder."""
    return Path(f"{serial}-{time.strftime('%Y%m%dT%H%M%S')}.mcap")

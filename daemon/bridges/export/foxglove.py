"""Convert a recording to the schemas that Foxglove draws: tip, frames, measured balls, events.

Importing this module needs the package foxglove-sdk; nothing else in armd needs it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, TypeVar

import foxglove
from foxglove import channels
from foxglove import messages as schemas
from pydantic import BaseModel, ConfigDict, Field

from armd import keys
from armd.daemon.bridges.export.source import MeasurementLine, read_info
from armd.daemon.bridges.tips import Tips
from armd.daemon.files.recorder import TOPICS
from armd.drivers.replay.recording import Recording
from armd.files.schema import load_json_data, validate
from armd.files.writing import replace_file

M_PER_MM = 1e-3
BLUE = (0.12, 0.47, 0.71, 1.0)
#: A tip without a known radius must stay visible in the picture.
SMALLEST_RADIUS_MM = 0.5

#: Foxglove's time stamps hold 32 bits of seconds.
Stamp = Annotated[int, Field(ge=0, lt=2**32 * 10**9)]


class _Told(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class _Vector(_Told):
    x: float | None
    y: float | None
    z: float | None


class _Quaternion(_Vector):
    w: float | None


class _Point(_Told):
    stamp_ns: Stamp
    position_mm: _Vector
    orientation: _Quaternion


class _Measured(MeasurementLine):
    stamp_ns: Stamp


class _Event(_Told):
    stamp_ns: Stamp
    kind: str
    text: str
    severity: str


Content = TypeVar("Content", bound=BaseModel)


def write_foxglove(recording: Recording, path: Path) -> tuple[int, int]:
    """Write *path* and return the numbers of points and measurements written.

    Raises `BadInput` for a damaged recording. The file appears whole or not at all.
    """
    info = read_info(recording)
    serial = info["arm"]["serial_number"]
    draw = _Drawing(serial, Tips(info))
    context = foxglove.Context()
    points = measurements = 0
    with (
        replace_file(path) as part,
        foxglove.open_mcap(part, allow_overwrite=True, context=context),
    ):
        tip = channels.PoseInFrameChannel(f"/{serial}/tip", context=context)
        frames = channels.FrameTransformChannel("/tf", context=context)
        balls = channels.SceneUpdateChannel(f"/{serial}/measurements", context=context)
        log = channels.LogChannel(f"/{serial}/events", context=context)
        health = foxglove.Channel(f"/{serial}/health", message_encoding="json", context=context)
        for topic_key, unix_ns, data in _messages(recording):
            if topic_key == keys.POINT:
                point = _read(recording, topic_key, data, _Point)
                if point.position_mm.x is not None:
                    tip.log(draw.tip(point), log_time=point.stamp_ns)
                    frames.log(draw.frame(point), log_time=point.stamp_ns)
                    points += 1
            elif topic_key == keys.MEASUREMENT:
                measured = _read(recording, topic_key, data, _Measured)
                if measured.position_mm is not None:
                    balls.log(draw.ball(measured), log_time=measured.stamp_ns)
                    measurements += 1
            elif topic_key == keys.EVENT:
                event = _read(recording, topic_key, data, _Event)
                log.log(draw.event(event), log_time=event.stamp_ns)
            else:
                health.log(data, log_time=unix_ns)
    return points, measurements


def _messages(recording: Recording) -> Iterator[tuple[str, int, Any]]:
    by_topic = {topic: topic_key for topic_key, topic in TOPICS.items()}
    for message in recording.messages(set(by_topic)):
        yield by_topic[message.topic], message.unix_ns, load_json_data(recording.path, message.data)


def _read(recording: Recording, topic_key: str, data: Any, model: type[Content]) -> Content:
    return validate(f"{recording.path}: {TOPICS[topic_key]}", data, model)


class _Drawing:
    """The Foxglove messages of one arm, in metres, in the frame `SERIAL_base`."""

    def __init__(self, serial: str, tips: Tips) -> None:
        self._base, self._tip = f"{serial}_base", f"{serial}_tip"
        self._tips = tips

    def tip(self, point: _Point) -> schemas.PoseInFrame:
        return schemas.PoseInFrame(
            timestamp=_stamp(point.stamp_ns),
            frame_id=self._base,
            pose=schemas.Pose(
                position=_metres(point.position_mm), orientation=_turned(point.orientation)
            ),
        )

    def frame(self, point: _Point) -> schemas.FrameTransform:
        return schemas.FrameTransform(
            timestamp=_stamp(point.stamp_ns),
            parent_frame_id=self._base,
            child_frame_id=self._tip,
            translation=_metres(point.position_mm),
            rotation=_turned(point.orientation),
        )

    def ball(self, measured: _Measured) -> schemas.SceneUpdate:
        """Return a scene with the tip's ball, which stays where it was measured."""
        x, y, z = measured.position_mm or (0.0, 0.0, 0.0)
        radius_mm = max(self._tips.get(measured.tip).radius_mm, SMALLEST_RADIUS_MM)
        side = 2 * radius_mm * M_PER_MM
        r, g, b, a = BLUE
        ball = schemas.SpherePrimitive(
            pose=schemas.Pose(
                position=_metres(_Vector(x=x, y=y, z=z)), orientation=schemas.Quaternion(w=1.0)
            ),
            size=schemas.Vector3(x=side, y=side, z=side),
            color=schemas.Color(r=r, g=g, b=b, a=a),
        )
        metadata = {
            "seq": measured.seq, "flags": " ".join(measured.flag_names),
            "x_mm": x, "y_mm": y, "z_mm": z, "tip": measured.tip or "",
        }  # fmt: skip
        entity = schemas.SceneEntity(
            timestamp=_stamp(measured.stamp_ns),
            frame_id=self._base,
            id=str(measured.seq),
            metadata=[schemas.KeyValuePair(key=k, value=str(v)) for k, v in metadata.items()],
            spheres=[ball],
        )
        return schemas.SceneUpdate(entities=[entity])

    def event(self, event: _Event) -> schemas.Log:
        levels = {"warning": schemas.LogLevel.Warning, "error": schemas.LogLevel.Error}
        return schemas.Log(
            timestamp=_stamp(event.stamp_ns),
            level=levels.get(event.severity, schemas.LogLevel.Info),
            message=event.text,
            name=event.kind,
        )


def _stamp(stamp_ns: int) -> schemas.Timestamp:
    return schemas.Timestamp(*divmod(stamp_ns, 10**9))


def _metres(position_mm: _Vector) -> schemas.Vector3:
    x, y, z = (value or 0.0 for value in (position_mm.x, position_mm.y, position_mm.z))
    return schemas.Vector3(x=x * M_PER_MM, y=y * M_PER_MM, z=z * M_PER_MM)


def _turned(q: _Quaternion) -> schemas.Quaternion:
    return schemas.Quaternion(x=q.x or 0.0, y=q.y or 0.0, z=q.z or 0.0, w=q.w or 0.0)

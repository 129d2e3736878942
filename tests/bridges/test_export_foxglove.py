"""`armd export RECORDING -o OUT.mcap`: Foxglove's own schemas, read back by the mcap library."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from mcap.reader import make_reader

from armd import POINT, Flag, keys
from armd.daemon.cli import main
from armd.daemon.files.recorder import Recorder

pytest.importorskip("foxglove")

NS = 1_700_000_000_123_456_789
INFO = {
    "arm": {"serial_number": "S-1", "tip": {"offset_mm": [0.0, 0.0, 100.0], "radius_mm": 3.0}},
    "configuration": {
        "driver": {"kind": "serial", "port": "/dev/x"},
        "tips": {"small": {"offset_mm": [0.0, 0.0, 90.0], "radius_mm": 1.0}},
    },
}
MEASUREMENT: dict[str, Any] = {
    "seq": 8, "stamp_ns": NS + 5, "position_mm": [100.0, -200.0, 300.0], "flags": 512,
    "flag_names": ["AT_REST"], "tip": "small",
}  # fmt: skip
EVENT = {
    "kind": "silence", "text": "no samples for 0.5 s", "severity": "warning", "stamp_ns": NS + 7
}  # fmt: skip


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    points = np.zeros(3, POINT)
    points["seq"], points["stamp_ns"] = [1, 2, 3], [NS, NS + 1, NS + 2]
    points["position_mm"] = [100.0, -200.0, 300.5]
    points["orientation"] = [0.5, -0.5, 0.5, 0.5]
    points["flags"][1] = int(Flag.INVALID)
    points["position_mm"][1] = points["orientation"][1] = np.nan
    path = tmp_path / "r.mcap"
    with path.open("wb") as file:
        recorder = Recorder(file, INFO, None)
        recorder.take_points([point.tobytes() for point in points])
        nowhere = MEASUREMENT | {"seq": 9, "position_mm": None}
        for what, told in (
            (keys.MEASUREMENT, MEASUREMENT), (keys.MEASUREMENT, nowhere), (keys.EVENT, EVENT),
            (keys.HEALTH, {"state": "READY", "points_hz": 1000.0}),
        ):  # fmt: skip
            recorder.take_messages(what, [json.dumps(told).encode()])
        recorder.close()
    return path


def test_each_in_the_schema_that_foxglove_draws(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.mcap"
    for _ in range(2):  # the second time over the first one's file
        assert main(["export", str(recording), "-o", str(out)]) == 0
    assert "2 points, 1 measurement" in capsys.readouterr().out
    told: dict[str, list[tuple[str, int, Any]]] = {}
    with out.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            name = schema.name if schema else ""
            data = (
                decoded(schema, name, message.data)
                if name.startswith("foxglove.")
                else json.loads(message.data)
            )
            told.setdefault(channel.topic, []).append((name, message.log_time, data))
    turn = {"x": 0.5, "y": -0.5, "z": 0.5, "w": 0.5}
    place = {"x": 0.1, "y": -0.2, "z": 0.3005}
    first, last = told["/S-1/tip"]
    assert first[:2] == ("foxglove.PoseInFrame", NS) and last[1] == NS + 2
    assert first[2] == {
        "timestamp": "2023-11-14T22:13:20.123456789Z",
        "frameId": "S-1_base",
        "pose": {"position": pytest.approx(place), "orientation": turn},
    }
    assert [m[1] for m in told["/tf"]] == [NS, NS + 2]
    frame = told["/tf"][0][2]
    assert (frame["parentFrameId"], frame["childFrameId"]) == ("S-1_base", "S-1_tip")
    assert frame["translation"] == pytest.approx(place) and frame["rotation"] == turn
    ((name, stamp_ns, scene),) = told["/S-1/measurements"]
    assert (name, stamp_ns) == ("foxglove.SceneUpdate", NS + 5)
    (entity,) = scene["entities"]
    (ball,) = entity["spheres"]
    assert entity["id"] == "8"
    assert {"key": "flags", "value": "AT_REST"} in entity["metadata"]
    assert ball["pose"]["position"] == pytest.approx({"x": 0.1, "y": -0.2, "z": 0.3})
    assert ball["size"] == pytest.approx({"x": 0.002, "y": 0.002, "z": 0.002})  # the small tip's
    ((name, stamp_ns, log),) = told["/S-1/events"]
    assert (name, stamp_ns) == ("foxglove.Log", NS + 7)
    assert (log["level"], log["message"], log["name"]) == ("WARNING", EVENT["text"], "silence")
    assert told["/S-1/health"][0][2] == {"state": "READY", "points_hz": 1000.0}


def decoded(schema: Any, name: str, data: bytes) -> Any:
    """By the file's own schema, as any reader would."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    message = message_factory.GetMessageClass(pool.FindMessageTypeByName(name))()
    message.ParseFromString(data)
    return json_format.MessageToDict(message)


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["r.mcap", "--since", "2026-01-01"], "--since"),
        (["--log"], "--log"),
        (["m.jsonl"], "m.jsonl"),
    ],
)
def test_only_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], found: str
) -> None:
    assert main(["export", *words, "-o", str(tmp_path / "out.mcap")]) == 2
    assert f"found {found}" in capsys.readouterr().err.replace("'", "")


def test_a_recording_is_not_written_over(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "precious.mcap"
    other.write_bytes(recording.read_bytes())
    assert main(["export", str(recording), "-o", str(other)]) == 2
    assert "a recording, which cannot be had again" in capsys.readouterr().err


def test_what_makes_no_sense_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "r.mcap"
    with path.open("wb") as file:
        recorder = Recorder(file, INFO, None)
        recorder.take_messages(keys.EVENT, [json.dumps(EVENT | {"stamp_ns": -1}).encode()])
        recorder.close()
    out = tmp_path / "out.mcap"
    assert main(["export", str(path), "-o", str(out)]) == 2
    assert "r.mcap: /event: stamp_ns: found -1" in capsys.readouterr().err
    assert not out.exists()

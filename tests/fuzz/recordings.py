"""Recordings (MCAP): damaged files, and forged ones: damaged content behind sound checksums."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from fuzz.doors import Door, run
from fuzz.files import sealed
from mcap.writer import Writer

from armd import POINT, keys
from armd.daemon.files.recorder import TOPICS, as_json
from armd.drivers.replay import raw
from armd.drivers.replay.recording import CALIBRATION_ATTACHMENT, INFO_ATTACHMENT, RAW_TOPIC
from armd.drivers.sample import RawFrame
from armd.drivers.serial import wire
from support.careless_network import EVENT, HEALTH, MEASUREMENT
from support.small_arm_toml import ARM, CALIBRATION

NS = 1_700_000_000_123_456_789
#: Between two frames of a seed.
CUT = b"\n--\n"


def frames() -> list[bytes]:
    """Of a serial arm: who it is, and forty samples."""
    name = ARM["serial_number"]
    sent = [wire.encode_hello(wire.Hello(1, 3, 0, 1000, 7, name, (20,) * 3))]
    sent += [wire.encode_sample(k, 1000 * k, np.arange(3) + k) for k in range(1, 41)]
    ms = 10**6
    return [
        raw.pack(k, RawFrame(10**12 + k * ms, NS + k * ms, "rx", data, "tty"))
        for k, data in enumerate(sent)
    ]


def info(driver: dict[str, Any]) -> bytes:
    configuration = {"schema": "armd.daemon/1", "arm": "arm.toml", "tips": {}, "driver": driver}
    return json.dumps({"arm": ARM, "configuration": configuration}).encode()


def recording(
    described: bytes, calibration: bytes, raws: list[bytes], messages: dict[str, list[bytes]]
) -> bytes:
    """As `armd record` lays it out, whatever it holds."""
    file = io.BytesIO()
    writer = Writer(file, chunk_size=2000)
    writer.start(profile="armd")
    for name, data in ((INFO_ATTACHMENT, described), (CALIBRATION_ATTACHMENT, calibration)):
        writer.add_attachment(NS, NS, name, "application/json", data)
    channel = writer.register_channel(RAW_TOPIC, "x", schema_id=0)
    for k, payload in enumerate(raws):
        writer.add_message(channel, NS + k, payload, NS + k)
    for topic, told in messages.items():
        channel = writer.register_channel(topic, "json", schema_id=0)
        for payload in told:
            writer.add_message(channel, NS, payload, NS)
    writer.finish()
    return file.getvalue()


def recording_doors(folder: Path) -> Iterator[Door]:
    folder.mkdir(parents=True)
    path = folder / "r.mcap"
    serial = info({"kind": "serial", "port": "x"})
    calibration = sealed(json.dumps(CALIBRATION).encode())
    points = np.zeros(4, POINT)
    points["seq"], points["stamp_ns"] = range(4), NS
    told = {
        TOPICS[keys.POINT]: as_json(points),
        TOPICS[keys.MEASUREMENT]: [json.dumps(MEASUREMENT).encode()],
        TOPICS[keys.EVENT]: [json.dumps(EVENT | {"severity": "info"}).encode()],
        TOPICS[keys.HEALTH]: [json.dumps(HEALTH).encode()],
    }
    replay = ["replay", str(path), "--check", "-o", str(folder / "out.csv"), "--force"]
    exported = [
        ["export", str(path), "-o", str(folder / f"out.{suffix}"), "--force"]
        for suffix in ("csv", "mcap")
    ]

    def door(name: str, seed: bytes, forge: Callable[[bytes], bytes]) -> Door:
        def enter(data: bytes) -> None:
            path.write_bytes(forge(data))
            for words in (replay, *exported):
                code, said = run(words)
                if code == 2 and data == seed:
                    raise ValueError(f"sound input is refused: {said}")

        return Door(f"recording, {name}", [seed], enter)

    def messages(data: bytes) -> dict[str, list[bytes]]:
        lines = iter(data.split(b"\n"))
        return {topic: [next(lines, b"") for _ in those] for topic, those in told.items()}

    raws = frames()
    yield door("file", recording(serial, calibration, raws, told), bytes)
    yield door("info", serial, lambda data: recording(data, calibration, raws, told))
    yield door("calibration", calibration,
               lambda data: recording(serial, sealed(data), raws, told))  # fmt: skip
    yield door("frames", CUT.join(raws),
               lambda data: recording(serial, calibration, data.split(CUT), told))  # fmt: skip
    yield door("messages", b"\n".join(line for those in told.values() for line in those),
               lambda data: recording(serial, calibration, raws, messages(data)))  # fmt: skip

"""`armd replay FILE`: play a recording through the same decoder and kernel.

Its points are published like a live arm's, or compared with the recorded ones, or written to a
table. They use the recorded calibration, or another one.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import armd
from armd import Flag, keys
from armd.compensation.model.arm import Arm
from armd.daemon.commands.service.run import serve
from armd.daemon.config import Config, DaemonFile
from armd.daemon.files.recorder import TOPICS, as_json
from armd.daemon.live.arm_in_use import ArmInUse
from armd.drivers.replay.recording import CALIBRATION_ATTACHMENT, Recording
from armd.drivers.sample import Event, Temperatures
from armd.drivers.table import open_driver
from armd.errors import BadInput
from armd.files.outputs import POINTS, add_force, check_outputs
from armd.files.schema import validate
from armd.files.writing import replace_file
from armd.printable import to_printable
from armd.terminal.aside import make_aside
from armd.terminal.counted import format_count

Points = npt.NDArray[np.void]
SETTLING_NS = 1_500_000_000
COLUMNS = ["seq", "stamp_ns", "x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw", "flags"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", type=Path, help="a file of `armd record`")
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--calibration", metavar="CAL.json", type=Path, help="instead of the recorded one"
    )
    which.add_argument("--nominal", action="store_true", help="without any calibration")
    parser.add_argument(
        "--speed", type=float, default=1.0, metavar="X", help="of publishing (1); 0: at once"
    )
    parser.add_argument("--listen", default=armd.ENDPOINT, help=f"({armd.ENDPOINT})")
    parser.add_argument(
        "--check", action="store_true", help="publish nothing; compare with the recorded points"
    )
    parser.add_argument(
        "-o", "--output", metavar="POINTS.csv", type=Path, help="publish nothing; write a table"
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Replay; the exit code is 1 if a point differs with --check."""
    check_outputs({"-o": (args.output, POINTS)}, [args.file, args.calibration], args.force)
    recording = Recording(args.file)
    with tempfile.TemporaryDirectory() as folder:
        config = _make_config(recording, args, Path(folder))
        if not args.check and args.output is None:
            return serve(config)
        with make_aside(args).status("playing the recording …"):
            points = np.concatenate([np.zeros(0, armd.POINT), *_iterate_points(config)])
        if args.output is not None:
            _write(args.output, points)
            print(f"armd: {args.output}: {format_count(len(points), 'point')}")
        return _compare(recording, points) if args.check else 0


def _make_config(recording: Recording, args: argparse.Namespace, folder: Path) -> Config:
    """Return the recorded daemon's configuration, with the recording instead of the arm."""
    calibration = args.calibration and args.calibration.absolute()
    recorded = recording.attachments.get(CALIBRATION_ATTACHMENT)
    if calibration is None and recorded is not None and not args.nominal:
        calibration = folder / CALIBRATION_ATTACHMENT
        calibration.write_bytes(recorded)
    offline = args.check or args.output is not None
    content: dict[str, Any] = recording.info["configuration"] | {
        "calibration": str(calibration) if calibration else None,
        "driver": {
            "kind": "replay",
            "file": str(recording.path.absolute()),
            "speed": 0 if offline else args.speed,
        },
        "zenoh": {"listen": [args.listen]},
        "metrics": None,
        "commands": {"enabled": False},  # a recording cannot be changed
    }
    file = validate(recording.path, content, DaemonFile)
    arm = validate(recording.path, recording.info["arm"], Arm)
    return Config(folder / "armd.toml", file, arm)


def _iterate_points(config: Config) -> Iterator[Points]:
    """Yield the points that the daemon would publish."""
    pipeline = ArmInUse(config).pipeline
    with closing(open_driver(config.driver, config.expectation)) as driver:
        while True:
            for item in driver.read(0.0):
                match item:
                    case Temperatures():
                        pipeline.take_temperatures(item)
                    case Event(kind="replay_ended"):
                        return
                    case Event(kind="recording_cut"):
                        print(to_printable(f"armd: {item.text}"), file=sys.stderr)
                    case Event():
                        pass
                    case samples:
                        yield pipeline.correct(samples)[0]


def _compare(recording: Recording, points: Points) -> int:
    """Compare with the recorded points; return the exit code.

    The beginning of a recording that began in mid-stream does not count: nobody knows for how long
    the tip had been at rest by then.
    """
    replayed = dict(zip(points["seq"].tolist(), as_json(points), strict=True))
    from_ns = int(points["monotonic_ns"][0]) if len(points) else 0
    from_ns += SETTLING_NS if recording.preamble() else 0
    identical = different = early = absent = 0
    for message in recording.messages({TOPICS[keys.POINT]}):
        try:
            point = json.loads(message.data)
            seq, at_ns = int(point["seq"]), int(point["monotonic_ns"])
        except (ValueError, OverflowError, KeyError, TypeError, RecursionError) as error:
            raise BadInput(recording.path, "/point", repr(message.data[:40]), "a point") from error
        if seq not in replayed:
            absent += 1
        elif at_ns < from_ns:
            early += 1
        else:
            same = replayed[seq] == message.data
            identical += same
            different += not same
    print(f"armd: {format_count(identical, 'point')} bit-identical, {different} different")
    for count, why in (
        (early, f"the first {SETTLING_NS / 1e9:g} s of a recording that began in mid-stream"),
        (absent, "their frames are not in the recording"),
    ):
        if count:
            print(f"armd: {format_count(count, 'recorded point')} not compared: {why}")
    return 1 if different or not identical else 0


def _write(path: Path, points: Points) -> None:
    with replace_file(path) as part, part.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for point in points:
            invalid = bool(point["flags"] & Flag.INVALID)
            pose = [*point["position_mm"].tolist(), *point["orientation"].tolist()]
            numbers = [""] * len(pose) if invalid else pose
            writer.writerow([point["seq"], point["stamp_ns"], *numbers, point["flags"]])

"""`armd record [SERIAL]`: record all messages of an arm's daemon in an MCAP file.

`armd record --session DIR`: record its measurements in a session for `armd calibrate`.

`armd record --lake DIR`: record its points with joints and temperatures in Parquet files.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import armd
from armd import keys
from armd.client import Arm
from armd.daemon.files.recorder import TOPICS, Recorder, choose_default_path
from armd.daemon.state import State
from armd.errors import BadInput
from armd.files.outputs import RECORDING, add_force, check_output_folder, check_outputs
from armd.files.writing import explain_os_errors
from armd.printable import to_printable
from armd.stream import Stream
from armd.terminal.arguments import add_arm, parse_seconds
from armd.terminal.counted import format_count

POLL_S = 0.01
WAIT_S = 60.0  # for an arm to show up
FIRST_S = 1.0  # for its frames to begin
FIRST_JOINTS_S = 3.0  # for its joints to begin; it publishes them only on request
#: Points that may be queued while a file is written: two minutes at 1 kHz, in 18 MB.
WAITING_POINTS = 1 << 17


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm(parser)
    add_force(parser)
    output = parser.add_mutually_exclusive_group()
    output.add_argument(
        "-o", "--output", metavar="FILE", type=Path, help="(SERIAL-DATE.mcap in this folder)"
    )
    output.add_argument(
        "--session", metavar="DIR", type=Path, help="measurements instead, as a session's readings"
    )
    output.add_argument(
        "--lake",
        metavar="DIR",
        type=Path,
        help="points with joints and temperatures instead, as Parquet by arm and day",
    )
    parser.add_argument(
        "--seconds", type=parse_seconds, metavar="S", help="stop by itself (at Ctrl-C)"
    )
    session = parser.add_argument_group("with --session")
    session.add_argument(
        "--artefact", metavar="FILE", type=Path, help="TOML with the table [artefact] (a seat)"
    )
    session.add_argument(
        "--targets",
        metavar="NAME,…",
        type=lambda names: names.split(","),
        help="where the tip goes, reading by reading, again and again (all of the artefact's)",
    )
    session.add_argument("--placement", metavar="NAME", help="of the artefact in the room (1)")


def run(args: argparse.Namespace) -> int:
    """Record until the end, and return the exit code.

    It is 1 if nothing came over the wire, if raw frames or points were lost on the way here, or if
    a session got no reading; else 0.
    """
    if args.lake is not None:
        check_output_folder(args.lake)
    if args.session is None:
        for option in ("artefact", "targets", "placement"):
            if getattr(args, option) is not None:
                raise BadInput("the command line", f"--{option}", "no --session", "it as well")
        check_outputs({"-o": (args.output, RECORDING)}, [], args.force)
        if args.output is not None and (args.output.is_fifo() or args.output.is_socket()):
            raise BadInput(args.output, "-o", "a pipe, which may keep us waiting", "a file")
    else:
        check_output_folder(args.session)
    stopping = False

    def stop(*_: object) -> None:
        nonlocal stopping
        stopping = True

    signal.signal(signal.SIGINT, stop)
    signal.signal(signal.SIGTERM, stop)
    with armd.connect(args.serial, args.endpoint, timeout_s=WAIT_S) as arm:
        end_s = time.monotonic() + (args.seconds or float("inf"))
        record = _record_frames
        if args.session is not None:
            record = _record_session
        elif args.lake is not None:
            record = _record_lake
        return record(args, arm, lambda: not stopping and time.monotonic() < end_s)


def _record_session(args: argparse.Namespace, arm: Arm, going_on: Callable[[], bool]) -> int:
    from armd.compensation.model.arm import Arm as ArmFile
    from armd.daemon.files.session_folder import SessionFolder, load_artefact

    artefact = load_artefact(args.artefact, args.targets or [])
    info = arm.info()
    trigger = info["configuration"]["measurement"]["trigger"]
    folder = SessionFolder(
        args.session,
        ArmFile.model_validate_json(json.dumps(info["arm"])),
        artefact,
        args.targets or artefact.target_names,
        args.placement or "1",
    )
    heard: deque[bytes] = deque()
    with arm.calling(keys.MEASUREMENT, heard.append):  # only new ones
        print(
            to_printable(f"armd: {arm.serial} to {args.session}; first {folder.target}"), flush=True
        )
        while going_on():
            time.sleep(POLL_S)
            while heard:
                measurement = json.loads(heard.popleft())
                if measurement.get("trigger") != trigger:
                    continue  # a press during a rest that is already a reading
                try:
                    text = folder.take(measurement)
                except (KeyError, TypeError, ValueError) as error:
                    text = f"passed over, no measurement of armd's: {to_printable(repr(error))}"
                print(f"{folder.n:4d}  {text}; next {folder.target}", flush=True)
    print(f"armd: {args.session}: {format_count(folder.n, 'reading')}")
    return 0 if folder.n else 1


def _record_lake(args: argparse.Namespace, arm: Arm, going_on: Callable[[], bool]) -> int:
    from armd.daemon.files.lake import FILE_S, Lake

    info = arm.info()["arm"]
    sensors = [sensor["name"] for sensor in info.get("temperature_sensor", [])]
    n_joints = len(info["joint"])
    with ExitStack() as opened:
        lake = opened.enter_context(closing(Lake(args.lake, arm.serial, n_joints, sensors)))
        health = opened.enter_context(arm.stream(keys.HEALTH))
        joints = opened.enter_context(arm.stream(keys.JOINTS, WAITING_POINTS))
        first = _receive_first(joints, FIRST_JOINTS_S)
        # Subscribe to points only now, so that each of them has its joints.
        points = opened.enter_context(arm.stream(keys.POINT, WAITING_POINTS))

        def take(messages: list[dict[str, Any]], first: Sequence[bytes] = ()) -> None:
            for message in messages:
                lake.take_temperatures(message["stamp_ns"], message["temperatures"])
            waiting = points.take()
            arm.decode(waiting)  # counts lost points
            lake.take(waiting, [*first, *joints.take()])

        take([arm.state()], first)
        print(to_printable(f"armd: recording {arm.serial} to {lake.folder}"), flush=True)
        _warn_unless_ready(arm)
        write_s = time.monotonic() + FILE_S
        while going_on():
            time.sleep(POLL_S)
            take([json.loads(payload) for payload in health.take()])
            if time.monotonic() >= write_s:
                write_s = time.monotonic() + FILE_S
                lake.write()
        take([])
    lost, without = arm.lost.here, lake.without_joints
    summary = f"{format_count(lake.rows, 'point')} in {format_count(lake.files, 'file')}"
    print(to_printable(f"armd: {lake.folder}: {summary}; {lost} lost, {without} without joints"))
    return 0 if lake.rows and not lost and not without else 1


def _record_frames(args: argparse.Namespace, arm: Arm, going_on: Callable[[], bool]) -> int:
    with ExitStack() as opened:
        output = args.output or choose_default_path(arm.serial)
        opened.enter_context(explain_os_errors(output))
        # Buffered: mcap would buffer a raw file itself, and not flush the last few bytes. A killed
        # recorder loses the chunk in progress either way.
        file = opened.enter_context(output.open("wb" if args.output else "xb"))
        recorder = opened.enter_context(closing(Recorder(file, arm.info(), arm.calibration_file())))
        raw = opened.enter_context(arm.stream(keys.RAW))
        points = opened.enter_context(arm.stream(keys.POINT))
        messages = {
            topic_key: opened.enter_context(arm.stream(topic_key))
            for topic_key in TOPICS
            if topic_key != keys.POINT
        }
        # Once frames arrive, none is missed; the preamble describes those before them.
        waiting = _receive_first(raw, FIRST_S)
        following, preamble = arm.preamble()
        recorder.begin(following, preamble)
        recorder.take_frames(waiting)
        print(to_printable(f"armd: recording {arm.serial} to {output}"), flush=True)
        _warn_unless_ready(arm)
        while going_on():
            time.sleep(POLL_S)
            recorder.take_frames(raw.take())
            recorder.take_points(points.take())
            for topic_key, stream in messages.items():
                recorder.take_messages(topic_key, stream.take())
    counted = ", ".join(f"{n} {topic_key.strip('@')}" for topic_key, n in recorder.counts.items())
    print(f"armd: {output}: {counted}; {recorder.lost_frames} raw frames lost")
    if not recorder.counts[keys.RAW]:
        silence = f"armd: {output}: raw frames: found none, expected some: the arm's line is silent"
        print(to_printable(silence), file=sys.stderr)
        return 1
    return 1 if recorder.lost_frames else 0


def _warn_unless_ready(arm: Arm) -> None:
    """Warn at the beginning, because an empty file would show it only at the end."""
    health = arm.state()
    if health.get("state") == State.NOT_READY:
        text = f"armd: warning: {arm.serial} is {State.NOT_READY}: {health.get('reason')}"
        print(to_printable(text), file=sys.stderr, flush=True)


def _receive_first(stream: Stream, seconds: float) -> list[bytes]:
    """Return the first payloads that arrive; none from an arm that is silent."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        if payloads := stream.take():
            return payloads
        time.sleep(POLL_S)
    return []

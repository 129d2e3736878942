"""`armd record [SERIAL]`: everything an arm's daemon says, into an MCAP file."""

from __future__ import annotations

import argparse
import signal
import time
from contextlib import ExitStack, closing
from pathlib import Path

import armd
from armd import keys
from armd.client import Stream
from armd.daemon.recorder import TOPICS, Recorder, default_path

POLL_S = 0.01
WAIT_S = 60.0  # for an arm to show up
FIRST_S = 1.0  # for its frames to begin


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("serial", nargs="?", help="serial number (the one arm that is there)")
    parser.add_argument("--endpoint", default=armd.ENDPOINT, help=f"({armd.ENDPOINT})")
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, help="(SERIAL-DATE.mcap in this folder)"
    )
    parser.add_argument("--seconds", type=float, metavar="S", help="stop by itself (at Ctrl-C)")


def run(args: argparse.Namespace) -> int:
    """0; 1 if raw frames were lost on the way here."""
    stopping = False

    def stop(*_: object) -> None:
        nonlocal stopping
        stopping = True

    signal.signal(signal.SIGINT, stop)
    signal.signal(signal.SIGTERM, stop)
    with armd.connect(args.serial, args.endpoint, timeout_s=WAIT_S) as arm, ExitStack() as opened:
        output = args.output or default_path(arm.serial)
        # Buffered: mcap would buffer a raw file itself, and not flush the last few bytes. What a
        # killed recorder loses is the chunk in progress either way.
        file = opened.enter_context(output.open("wb"))
        recorder = opened.enter_context(closing(Recorder(file, arm.info())))
        raw = opened.enter_context(arm.stream(keys.RAW))
        points = opened.enter_context(arm.stream(keys.POINT))
        messages = {
            what: opened.enter_context(arm.stream(what)) for what in TOPICS if what != keys.POINT
        }
        # Once frames arrive none is missed; the preamble tells what came before them.
        waiting = _first(raw)
        following, preamble = arm.preamble()
        recorder.begin(following, preamble)
        recorder.take_frames(waiting)
        print(f"armd: recording {arm.serial} to {output}", flush=True)
        end_s = time.monotonic() + (args.seconds or float("inf"))
        while not stopping and time.monotonic() < end_s:
            time.sleep(POLL_S)
            recorder.take_frames(raw.take())
            recorder.take_points(points.take())
            for what, stream in messages.items():
                recorder.take_messages(what, stream.take())
    counted = ", ".join(f"{n} {what.strip('@')}" for what, n in recorder.counts.items())
    print(f"armd: {output}: {counted}; {recorder.lost_frames} raw frames lost")
    return 1 if recorder.lost_frames else 0


def _first(stream: Stream) -> list[bytes]:
    """The first payloads that arrive; none from an arm that is silent."""
    end_s = time.monotonic() + FIRST_S
    while time.monotonic() < end_s:
        if payloads := stream.take():
            return payloads
        time.sleep(POLL_S)
    return []

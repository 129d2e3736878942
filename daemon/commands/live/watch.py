"""`armd watch [SERIAL]`: live read-out of an arm in the terminal, or one line of JSON per point."""

from __future__ import annotations

import argparse
import json
import math
from contextlib import suppress

import armd
from armd import Arm, Point, keys
from armd.daemon.commands.screen import Screen, generate_refreshes
from armd.daemon.commands.terminal import drop_output
from armd.terminal.arguments import add_arm, parse_seconds
from armd.terminal.plain import make_moving_console

REFRESH_S = 0.1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm(parser)
    parser.add_argument("--json", action="store_true", help="one line per point")
    parser.add_argument(
        "--seconds", type=parse_seconds, metavar="S", help="stop by itself (at Ctrl-C)"
    )


def run(args: argparse.Namespace) -> int:
    with armd.connect(args.serial, args.endpoint) as arm, suppress(KeyboardInterrupt):
        try:
            (_print_json if args.json else _show)(arm, args.seconds)
        except BrokenPipeError:  # the reader has ended, as in `armd watch --json | head -1`
            drop_output()
    return 0


def _print_json(arm: Arm, seconds: float | None) -> None:
    for point in arm.points(seconds):
        print(json.dumps(_to_json(point), allow_nan=False), flush=True)


def _to_json(point: Point) -> dict[str, object]:
    """Return a point as JSON: no NaN (null instead), flags also by name."""
    content: dict[str, object] = {
        name: [None if math.isnan(x) else x for x in value] if isinstance(value, tuple) else value
        for name, value in point._asdict().items()
    }
    return content | {"flags": int(point.flags), "flag_names": [flag.name for flag in point.flags]}


def _show(arm: Arm, seconds: float | None) -> None:
    with Screen(arm, make_moving_console()) as screen, arm.stream(keys.POINT) as stream:
        for elapsed_s in generate_refreshes(seconds, REFRESH_S):
            screen.show(arm.decode(stream.take()), elapsed_s)

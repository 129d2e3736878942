"""`armd stream [SERIAL]`: text lines over TCP, one per measurement or per point."""

from __future__ import annotations

import argparse

from armd.daemon.bridges import lines, process
from armd.daemon.bridges.listening import add_listen
from armd.daemon.bridges.stream import LineStream
from armd.errors import BadInput
from armd.terminal.arguments import add_arm

LISTEN = "127.0.0.1:1390"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm(parser)
    add_listen(parser, LISTEN)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--format", choices=lines.PRESETS, default="xyz", help="of a line (xyz)")
    form.add_argument(
        "--template",
        metavar="TEXT",
        help=f"a line of your own, as '{{x:.3f}};{{y:.3f}}'; fields: {', '.join(lines.FIELDS)}",
    )
    parser.add_argument(
        "--points", type=float, metavar="HZ", help="points instead, at most HZ a second"
    )


def run(args: argparse.Namespace) -> int:
    if args.points is not None and not 0 < args.points < float("inf"):
        problem = f"{args.points:g}"
        raise BadInput("the command line", "--points", problem, "a number of points per second")
    template = None if args.template is None else lines.parse_template(args.template)
    line = template or lines.PRESETS[args.format]
    header = lines.CSV_HEADER if line is lines.format_csv else None
    return process.serve(
        args, lambda arm: LineStream(arm, line, header, args.points).serve(args.listen)
    )

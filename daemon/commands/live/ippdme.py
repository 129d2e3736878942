"""`armd ippdme [SERIAL]`: an I++ DME server in manual mode, for inspection software."""

from __future__ import annotations

import argparse

from armd.daemon.bridges import process
from armd.daemon.bridges.ippdme.commands_2_5 import VERSIONS
from armd.daemon.bridges.ippdme.server import DmeServer
from armd.daemon.bridges.listening import add_listen
from armd.terminal.arguments import add_arm

LISTEN = "127.0.0.1:1294"
DME_VERSION = "1.4.3"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm(parser)
    add_listen(parser, LISTEN)
    parser.add_argument(
        "--dme-version", choices=VERSIONS, default=DME_VERSION, help=f"of I++ DME ({DME_VERSION})"
    )
    parser.add_argument(
        "--alias",
        type=_parse_alias,
        action="append",
        default=[],
        metavar="NAME=TIP",
        help="a name by which the host knows a tip (or RefTool), as PROBE1.TIP1A0B0=ball3",
    )


def _parse_alias(text: str) -> tuple[str, str]:
    name, equals, tip = text.rpartition("=")
    if not (equals and name and tip):
        raise argparse.ArgumentTypeError(f"found {text!r}, expected NAME=TIP")
    return name, tip


def run(args: argparse.Namespace) -> int:
    return process.serve(
        args, lambda arm: DmeServer(arm, args.dme_version, dict(args.alias)).serve(args.listen)
    )

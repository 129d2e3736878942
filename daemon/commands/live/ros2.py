"""`armd ros2 [SERIAL]`: publish native ROS 2 topics as rmw_zenoh does; `--urdf` writes the arm."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import armd
from armd.daemon.bridges import process
from armd.daemon.bridges.ros2 import urdf
from armd.daemon.bridges.ros2.bridge import Bridge, Settings
from armd.daemon.bridges.ros2.node import NAME, make_legal_name
from armd.errors import BadInput
from armd.files.outputs import OutputKind, add_force, check_outputs
from armd.files.writing import write_whole
from armd.printable import to_printable
from armd.terminal.arguments import add_arm

RATE_HZ = 100.0
MOST_DOMAINS = 232
URDF = OutputKind("a URDF", lambda head: b"<robot" in head)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm(parser)
    parser.add_argument(
        "--router", metavar="ENDPOINT", help="of ROS (rmw_zenohd), as tcp/ros-host:7447"
    )
    parser.add_argument("--domain", type=int, default=0, help="ROS_DOMAIN_ID (0)")
    parser.add_argument("--namespace", metavar="NAME", help="of the topics (the serial number)")
    parser.add_argument("--frame", metavar="NAME", help="the base frame (NAMESPACE_base)")
    parser.add_argument(
        "--rate", type=float, default=RATE_HZ, metavar="HZ", help=f"points a second ({RATE_HZ:g})"
    )
    parser.add_argument(
        "--urdf", type=Path, metavar="FILE", help="write the calibrated arm's URDF and end"
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    if not 0 <= args.domain <= MOST_DOMAINS:
        raise _make_option_fault("--domain", str(args.domain), f"a number from 0 to {MOST_DOMAINS}")
    if not 0 < args.rate < float("inf"):
        raise _make_option_fault("--rate", f"{args.rate:g}", "a number of points per second")
    if args.namespace is not None and not NAME.fullmatch(args.namespace.strip("/")):
        raise _make_option_fault(
            "--namespace", repr(args.namespace), "letters, digits and _, no digit first"
        )
    if args.urdf is not None:
        check_outputs({"--urdf": (args.urdf, URDF)}, [], args.force)
        with armd.connect(args.serial, args.endpoint) as arm:
            settings = _read_settings(args, arm.serial)
            calibration = arm.calibration_file()
            text = urdf.write(arm.info(), calibration, settings.namespace, settings.frame)
        write_whole(args.urdf, text)
        if sentence := urdf.describe_omissions(calibration):  # printed with -q, too
            print(f"armd: {args.urdf}: {to_printable(sentence)}", file=sys.stderr)
        return 0
    if args.router is None:
        raise _make_option_fault(
            "--router", "nothing", "the endpoint of ROS's router, or --urdf FILE"
        )
    return process.serve(args, lambda arm: Bridge(arm, _read_settings(args, arm.serial)).serve())


def _read_settings(args: argparse.Namespace, serial: str) -> Settings:
    namespace = (args.namespace or make_legal_name(serial)).strip("/")
    frame = args.frame or f"{namespace.replace('/', '_')}_base"
    return Settings(args.router or "", args.domain, namespace, frame, args.rate)


def _make_option_fault(option: str, problem: str, expected: str) -> BadInput:
    return BadInput("the command line", option, problem, expected)

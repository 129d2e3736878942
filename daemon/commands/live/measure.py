"""`armd measure KIND [SERIAL] -o SESSION`: guide a measurement on the live arm."""

from __future__ import annotations

import argparse
import signal
from pathlib import Path
from typing import get_args

import armd
from armd.client import Arm
from armd.compensation.data.sessions.format import ArtefactFile
from armd.daemon.measure.ending import EndOptions, Then, list_commands
from armd.daemon.measure.ending import run as run_command
from armd.daemon.measure.in_use import get_in_use
from armd.daemon.measure.measuring import Measuring
from armd.daemon.measure.plan.kinds import make_plan
from armd.daemon.measure.plan.stations import KINDS, MOST_STATIONS, Wishes
from armd.daemon.measure.plan.verify_stations import TESTS
from armd.daemon.measure.terminal import Terminal
from armd.errors import BadInput
from armd.files.inputs import check_input
from armd.files.outputs import check_output_folder
from armd.files.schema import load_toml
from armd.terminal.arguments import add_arm, parse_integer, parse_positive, parse_seconds

WAIT_S = 60.0  # for an arm to show up


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = (
        "kinds:\n"
        "  seats     the ball in one or more seats, again and again in other postures\n"
        "  artefact  the balls of --artefact, in several placements\n"
        "  verify    the points that ISO 10360-12 and ASME B89.4.22 want; without --artefact"
        " three seats\n"
        "  poses     the poses of a table of `armd design -o`\n"
        "  tip       a seat, or a sphere (--sphere-mm): the tip's offset\n"
        "  repeatability  one place, visited many times over hours: scatter and drift\n"
        "  interim   a short check, for `armd interim`; --proposed: the one it proposes\n"
        "while it runs, Enter after: d delete the last, a once more, s leave out, f finish, q stop"
    )
    parser.add_argument("kind", choices=KINDS, metavar="KIND", help=", ".join(KINDS))
    add_arm(parser)
    parser.add_argument(
        "-o",
        "--output",
        metavar="SESSION",
        type=Path,
        required=True,
        help="folder for the session; one that was interrupted is taken up again",
    )
    parser.add_argument("--json", action="store_true", help="one line per reading and refusal")
    parser.add_argument("--seconds", type=parse_seconds, metavar="S", help="stop by itself (never)")
    group = parser.add_argument_group("what to measure")
    group.add_argument(
        "--artefact", metavar="FILE", type=Path, help="TOML with the table [artefact] of a session"
    )
    group.add_argument("--targets", metavar="NAME,…", type=_parse_names, help="in this order (all)")
    group.add_argument(
        "--placements",
        metavar="NAME,…",
        type=_parse_names,
        help="of the artefact (artefact: P1,P2,P3)",
    )
    group.add_argument(
        "--repeats",
        metavar="N",
        type=lambda text: parse_integer(text, 1, MOST_STATIONS),
        help="rounds over the targets in each placement (seats: 10, artefact: 3,"
        " repeatability: 30)",
    )
    group.add_argument(
        "--poses",
        metavar="POSES.csv",
        type=Path,
        help="a table of `armd design -o`, or (interim) of `armd interim report --poses`",
    )
    group.add_argument(
        "--proposed",
        action="store_true",
        help="of interim: the check that --history proposes, where a cause is in doubt",
    )
    group.add_argument(
        "--tests", metavar="NAME,…", type=_parse_names, help=f"of verify: {', '.join(TESTS)} (all)"
    )
    group.add_argument(
        "--sphere-mm", metavar="D", type=parse_positive, help="certified diameter, of tip"
    )
    group.add_argument(
        "--near-mm",
        metavar="MM",
        type=parse_positive,
        help="a reading farther from its target is refused (5; coarse arms: 20 encoder steps)",
    )
    group.add_argument(
        "--artefact-c", metavar="C", type=float, help="the artefact's temperature, °C"
    )
    end = parser.add_argument_group("what to make of it")
    end.add_argument(
        "--then",
        metavar="COMMAND,…",
        type=_parse_names,
        help=f"{', '.join(get_args(Then))} (seats, poses: diagnose; artefact: calibrate, diagnose;"
        " without a calibration in force calibrate alone; the others: their own)",
    )
    end.add_argument(
        "--with", dest="others", nargs="+", default=[], metavar="SESSION", type=Path,
        help="sessions measured before, that take part",
    )  # fmt: skip
    end.add_argument("--mpe", metavar="MPE.toml", type=Path, help="limits, of verify")
    end.add_argument("--history", metavar="DIR", type=Path, help="of `armd interim`")
    end.add_argument("--name", metavar="TIP", help="what the history of tips calls the new one")
    end.add_argument(
        "--apply", action="store_true", help="put the new tip in force if its verdict is good"
    )


def run(args: argparse.Namespace) -> int:
    """Measure, run the final commands, and return the largest exit code of them.

    It is 1 if the measurement was interrupted before its end.
    """
    options = _read_options(args)
    check_output_folder(args.output)
    artefact = None if args.artefact is None else load_toml(args.artefact, ArtefactFile).artefact
    wishes = Wishes(
        targets=args.targets,
        placements=args.placements,
        repeats=args.repeats,
        poses=args.poses,
        proposed=args.history if args.proposed else None,
        tests=args.tests,
        near_mm=args.near_mm,
        sphere_mm=args.sphere_mm,
    )
    with armd.connect(args.serial, args.endpoint, timeout_s=WAIT_S) as arm:
        in_use = get_in_use(arm)
        plan = make_plan(args.kind, in_use.arm, artefact, wishes)
        with Measuring(args.output, plan, in_use) as measuring:
            # checked now, so that it is not refused at the end
            list_commands(measuring.folder, measuring.plan, measuring.in_use, options)
            if args.artefact_c is not None:
                measuring.set_artefact_c(args.artefact_c)
            return _lead_measurement(args, arm, measuring, options)


def _lead_measurement(
    args: argparse.Namespace, arm: Arm, measuring: Measuring, options: EndOptions
) -> int:
    trigger = arm.info()["configuration"]["measurement"]["trigger"]
    face = Terminal(arm, measuring, trigger, args.json)
    signal.signal(signal.SIGINT, lambda *_: face.stop())
    signal.signal(signal.SIGTERM, lambda *_: face.stop())
    finished = face.run(args.seconds)
    if not finished:
        face.close(finished)
        return 1
    measuring.finish()
    code = 0
    for command in list_commands(measuring.folder, measuring.plan, measuring.in_use, options):
        done = run_command(command)
        face.report_command(done)
        code = max(code, done.code)
    face.close(finished)
    return code


def _read_options(args: argparse.Namespace) -> EndOptions:
    for name in args.then or ():
        if name not in get_args(Then):
            expected = f"one of {', '.join(get_args(Then))}"
            raise BadInput("the command line", "--then", repr(name), expected)
    if args.mpe is not None:
        check_input(args.mpe)
    for path in args.others:
        check_input(path / "session.toml")
    if args.proposed and args.history is None:
        expected = "--history DIR: the history that proposes a check"
        raise BadInput("the command line", "--proposed", "it without a history", expected)
    if args.apply and args.kind != "tip":
        raise BadInput("the command line", "--apply", f"it with {args.kind}", "it with tip only")
    if args.apply and args.name is None:
        expected = "--name TIP: the calibration's own tip is the calibration's"
        raise BadInput("the command line", "--apply", "it without a name", expected)
    apply_at = args.endpoint if args.apply else None
    return EndOptions(args.then, args.others, args.mpe, args.history, args.name, apply_at)


def _parse_names(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise argparse.ArgumentTypeError(f"found {text!r}, expected names with commas between")
    return names

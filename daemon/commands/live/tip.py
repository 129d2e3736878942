"""`armd tip`: the tips of an arm listed, selected, calibrated, and their history.

    armd tip list [SERIAL]           armd tip calibrate SESSION [--name NAME]
    armd tip use NAME [SERIAL]       armd tip history [SERIAL] [--name NAME]
    armd tip apply NAME [SERIAL]

`armd tip NAME [SERIAL]` is short for `use`.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Column, Table

import armd
from armd.errors import BadInput
from armd.files.outputs import RESULT, add_force, check_outputs
from armd.files.writing import write_whole
from armd.printable import to_printable
from armd.terminal.arguments import add_endpoint, parse_positive
from armd.terminal.counted import format_count
from armd.terminal.suggest import suggest

OWN = "-"
VERBS = ("list", "use", "calibrate", "apply", "history")
#: Default of armd.toml's `limits.tip_offset_mm`: a tip that moved farther gives a warning.
LIMIT_MM = 0.1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "armd tip list [SERIAL]             the tips of armd.toml, and how well they are known\n"
        "armd tip use NAME [SERIAL]         measure with a tip of armd.toml from now on\n"
        f"armd tip use {OWN} [SERIAL]            with the calibration's own\n"
        "armd tip calibrate SESSION         the offset from a session of `armd measure tip`\n"
        "armd tip apply NAME [SERIAL]      put its last calibration in force, and keep it\n"
        "armd tip history [SERIAL]          calibrations of tips so far\n"
        "armd tip NAME [SERIAL]             short for `use`"
    )
    parser.add_argument("words", nargs="+", metavar="WORD", help="one of the lines above")
    add_endpoint(parser)
    parser.add_argument("--name", metavar="NAME", help="of the tip (calibrate: the one in use)")
    parser.add_argument(
        "--apply",
        action="store_true",
        help="of calibrate: put the tip in force on the running daemon, if the verdict is good",
    )
    parser.add_argument("--json", metavar="OUT.json", help="of calibrate: the result")
    parser.add_argument(
        "--sphere-mm", metavar="D", type=parse_positive, help="of calibrate: as the session has it"
    )
    parser.add_argument(
        "--limit-mm",
        metavar="MM",
        type=parse_positive,
        default=LIMIT_MM,
        help=f"of calibrate: how well the offset must be known, k = 2, and how far a tip may move"
        f" before it is warned of ({LIMIT_MM:g})",
    )
    parser.add_argument(
        "--form-mm",
        metavar="MM",
        type=parse_positive,
        help="of calibrate: largest form error (--limit-mm)",
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Run the verb and return the exit code; it is 1 for a calibration with a doubtful verdict."""
    verb, words = args.words[0], args.words[1:]
    if verb not in VERBS:
        if guess := suggest(verb, VERBS):  # a tip with such a name needs the verb `use`
            expected = f"one of {', '.join(VERBS)}, or the NAME of a tip{guess}"
            raise BadInput("the command line", "armd tip", repr(verb), expected)
        verb, words = "use", args.words
    max_words, expected = _WORDS[verb]
    if not (verb in ("list", "history") or words) or len(words) > max_words:
        raise BadInput(
            "the command line", f"armd tip {verb}", " ".join(words) or "nothing", expected
        )
    deeds = {
        "list": _list_tips,
        "use": _use_tip,
        "calibrate": _calibrate,
        "apply": _apply,
        "history": _print_history,
    }
    return deeds[verb](args, words)


_WORDS = {
    "list": (1, "[SERIAL]"),
    "use": (2, "NAME [SERIAL]"),
    "calibrate": (1, "SESSION"),
    "apply": (2, "NAME [SERIAL]"),
    "history": (1, "[SERIAL]"),
}


def _use_tip(args: argparse.Namespace, words: list[str]) -> int:
    name, serial = words[0], words[1] if len(words) > 1 else None
    with armd.connect(serial, args.endpoint) as arm:
        done = arm.command("tip", name="" if name == OWN else name)
        print(to_printable(f"{arm.serial}: {done}"))
    return 0


def _apply(args: argparse.Namespace, words: list[str]) -> int:
    from armd.daemon.files.tip_history import use_tip

    with armd.connect(words[1] if len(words) > 1 else None, args.endpoint) as arm:
        print(to_printable(f"{arm.serial}: {use_tip(arm, words[0])}"))
    return 0


def _list_tips(args: argparse.Namespace, words: list[str]) -> int:
    from armd.daemon.files.tip_history import read_history
    from armd.daemon.measure.in_use import get_in_use

    with armd.connect(words[0] if words else None, args.endpoint) as arm:
        info, in_use = arm.info(), get_in_use(arm)
        last = {entry["name"]: entry for entry in read_history(arm.serial)}
    table = Table(
        "", "tip", "offset, mm", "radius, mm", _make_when_column(), "U (k = 2), mm", "verdict"
    )
    tips: dict[str, dict[str, Any]] = {OWN: {"offset_mm": None}, **info["configuration"]["tips"]}
    for name, tip in tips.items():
        used = (info["tip"] or OWN) == name
        offset = in_use.offset_mm.tolist() if used else tip["offset_mm"]
        radius = (
            info["arm"]["tip"]["radius_mm"] if tip.get("radius_mm") is None else tip["radius_mm"]
        )
        calibration = last.get(name)
        table.add_row(
            "▶" if used else "",
            to_printable("the calibration's own (-)" if name == OWN else name),
            "" if offset is None else " ".join(f"{value:.3f}" for value in offset),
            f"{radius:.3f}",
            *(("never", "", "") if calibration is None else _format_calibration(calibration)),
        )
    Console().print(table)
    return 0


def _format_calibration(entry: dict[str, Any]) -> tuple[str, str, str]:
    expanded = 2 * max(entry["standard_uncertainty_mm"])
    # The verdict's reasons are in the calibration's output and in the file.
    return (
        _format_minute(entry),
        f"{expanded:.4f}",
        to_printable(entry["verdict"].partition(":")[0]),
    )


def _make_when_column() -> Column:
    return Column("calibrated, UTC", no_wrap=True, min_width=16)


def _format_minute(entry: dict[str, Any]) -> str:
    """Format the time of measurement to the minute, UTC."""
    return str(entry["measured"])[:16].replace("T", " ")


def _print_history(args: argparse.Namespace, words: list[str]) -> int:
    from armd.daemon.files.tip_history import locate_history_file, read_history

    serial = words[0] if words else None
    if serial is None:
        with armd.connect(None, args.endpoint) as arm:
            serial = arm.serial
    entries = read_history(serial, args.name)
    table = Table(
        _make_when_column(),
        "tip",
        "offset, mm",
        "U (k = 2), mm",
        "form, mm",
        "radius, mm",
        "verdict",
    )
    for entry in entries:
        radius = entry["radius_mm"]
        table.add_row(
            _format_minute(entry),
            to_printable(entry["name"]),
            " ".join(f"{value:.3f}" for value in entry["offset_mm"]),
            _format_calibration(entry)[1],
            f"{entry['form_error_mm']:.4f}",
            "" if radius is None else f"{radius:.4f}",
            _format_calibration(entry)[2],
        )
    console = Console()
    console.print(table)
    times = "calibration" if len(entries) == 1 else "calibrations"
    console.print(f"{len(entries)} {times}; {locate_history_file(serial)}", soft_wrap=True)
    return 0


def _calibrate(args: argparse.Namespace, words: list[str]) -> int:
    from armd.daemon.files.tip_history import keep, read_history
    from armd.daemon.measure.tip_calibration import calibrate_tip, measure_moved_mm

    folder = Path(words[0])
    if args.apply and args.name == OWN:
        expected = "a name: the calibration's own tip is the calibration's"
        raise BadInput("the command line", "--apply --name", OWN, expected)
    check_outputs({"--json": (args.json, RESULT)}, [folder], args.force)
    calibration = calibrate_tip(
        folder, args.name, args.sphere_mm, args.limit_mm, args.form_mm or args.limit_mm
    )
    entry = calibration.as_json()
    earlier = [
        past
        for past in read_history(calibration.serial, calibration.name)
        if past["session"] != entry["session"]
    ]
    moved, uncertainty, since = measure_moved_mm(calibration, earlier[-1] if earlier else None)
    entry |= {"moved_mm": moved, "moved_expanded_uncertainty_mm": uncertainty, "moved_since": since}
    history_path = keep(calibration.serial, entry)
    if args.json:
        write_whole(args.json, json.dumps({"schema": "armd.tip/1", **entry}, indent=1) + "\n")
    console, fit = Console(soft_wrap=True), calibration.fit
    n_readings = format_count(len(fit.residual_mm), "reading")
    expanded = " ".join(f"{2 * value:.4f}" for value in fit.uncertainty_mm)
    offset = ", ".join(f"{value:.4f}" for value in fit.offset_mm)
    console.print(to_printable(f"tip {calibration.name} of {calibration.serial}, {n_readings}"))
    console.print(f"offset        [{offset}] mm, U (k = 2) {expanded} mm", markup=False)
    if fit.radius_mm is not None and fit.radius_uncertainty_mm is not None:
        text = f"{fit.radius_mm:.4f} mm, U (k = 2) {2 * fit.radius_uncertainty_mm:.4f} mm"
        console.print(f"ball's radius {text}")
    console.print(f"form error    {fit.form_error_mm:.4f} mm")
    console.print(f"moved         {moved:.4f} mm, U (k = 2) {uncertainty:.4f} mm, since {since}")
    if moved > args.limit_mm:
        text = f"the offset moved by {moved:.3f} mm, more than {args.limit_mm:g} mm: was the tip"
        console.print(f"WARNING       {text} changed, loosened or hit?")
    console.print(f"verdict       {calibration.verdict}")
    console.print(to_printable(f"kept in       {history_path}"))
    if calibration.name != OWN:
        console.print(
            to_printable(f"for armd.toml [tips.{json.dumps(calibration.name)}]"), markup=False
        )
        console.print(f"              offset_mm = [{offset}]", markup=False)
        if fit.radius_mm is not None:
            console.print(f"              radius_mm = {fit.radius_mm:.4f}")
    if calibration.doubts:
        return 1
    return _apply(args, [calibration.name, calibration.serial]) if args.apply else 0

"""`armd export [SERIAL | FILE]`: write measurements to a file that other programs open.

The formats are `.csv`, `.xyz`, `.ply` and `.qif`; a recording can become an `.mcap` that Foxglove
draws.
"""

from __future__ import annotations

import argparse
import datetime
from collections.abc import Callable
from pathlib import Path

import armd
from armd.daemon.bridges.export import formats, source
from armd.daemon.bridges.export.source import Measurements
from armd.daemon.bridges.tips import Tips
from armd.daemon.files.measurement_log import locate_log_folder, locate_logs_folder
from armd.drivers.replay.recording import Recording
from armd.errors import BadInput
from armd.files.outputs import OutputKind, add_force, check_outputs
from armd.files.writing import write_whole
from armd.terminal.arguments import add_endpoint
from armd.terminal.aside import make_aside
from armd.terminal.counted import format_count

#: The tests of `formats`, and one for an earlier export to `.mcap`.
WRITTEN_BEFORE: dict[str, Callable[[bytes], bool]] = {
    **formats.WRITTEN_BEFORE,
    ".mcap": lambda head: head.startswith(b"\x89MCAP") and b"foxglove-sdk" in head[:100],
}
SUFFIXES = tuple(WRITTEN_BEFORE)
#: Default for a file without the arm's `info`: the tip's shaft is the last frame's z axis.
NO_INFO = {
    "arm": {"tip": {"offset_mm": [0.0, 0.0, 0.0], "radius_mm": 0.0}},
    "configuration": {"tips": {}},
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        nargs="?",
        metavar="SERIAL|FILE",
        help="an arm whose daemon runs, or its measurements as .jsonl, a log's folder, "
        "a recording .mcap (the one arm that is there)",
    )
    add_endpoint(parser)
    parser.add_argument(
        "--log",
        action="store_true",
        help="from this machine's measurement log: every one since the daemon was installed",
    )
    parser.add_argument(
        "--since", metavar="TIME", help="only later ones: 2026-03-01T09:00 (UTC), or Unix seconds"
    )
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, required=True, help=" ".join(SUFFIXES)
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    suffix = args.output.suffix.lower()
    if suffix not in SUFFIXES:
        raise BadInput(args.output, "the suffix", repr(suffix), f"one of {' '.join(SUFFIXES)}")
    kind = OutputKind("points of armd", WRITTEN_BEFORE[suffix])
    check_outputs({"-o": (args.output, kind)}, [args.source], args.force)
    if suffix == source.RECORDING:
        return _to_foxglove(args)
    since_ns = parse_instant_ns(args.since) if args.since else None
    with make_aside(args).status("reading the measurements …"):
        collection = _find(args)
    chosen = [m for m in collection.measurements if since_ns is None or m.stamp_ns >= since_ns]
    tips = Tips(collection.info or NO_INFO)
    write_whole(args.output, formats.as_text(suffix, chosen, tips, collection.serial))
    without = sum(m.position_mm is None for m in chosen)
    left_out = "their fields empty" if suffix == ".csv" else "left out"
    remark = f", {without} of them without a position: {left_out}" if without else ""
    print(f"armd: {args.output}: {format_count(len(chosen), 'measurement')}{remark}")
    for sentence in collection.left_out:
        print(f"armd: {sentence}")
    return 0


def _to_foxglove(args: argparse.Namespace) -> int:
    path = Path(args.source or "")
    if path.suffix != source.RECORDING or args.log or args.since:
        problem = "--since" if args.since else "--log" if args.log else repr(args.source or "")
        expected = "a recording (.mcap) alone, for an .mcap that Foxglove draws"
        raise BadInput("the command line", "SOURCE", problem, expected)
    try:
        from armd.daemon.bridges.export.foxglove import write_foxglove
    except ImportError as error:
        needs = "it installed: pip install foxglove-sdk"
        raise BadInput(args.output, "the package foxglove-sdk", "nothing", needs) from error
    recording = Recording(path)
    with make_aside(args).status("writing the recording …"):
        points, measurements = write_foxglove(recording, args.output)
    written = f"{format_count(points, 'point')}, {format_count(measurements, 'measurement')}"
    print(f"armd: {args.output}: {written}, for Foxglove")
    if recording.missing is not None:
        print(f"armd: {recording.missing}")
    return 0


def _find(args: argparse.Namespace) -> Measurements:
    if args.log:
        return source.from_path(_find_own_log(args.source))
    path = Path(args.source or "")
    if args.source and (path.exists() or path.suffix in (".jsonl", source.RECORDING)):
        return source.from_path(path)
    with armd.connect(args.source, args.endpoint) as arm:
        return source.from_arm(arm)


def _find_own_log(serial: str | None) -> Path:
    if serial:
        return locate_log_folder(serial)
    folders = locate_logs_folder()
    log_folders = sorted(path for path in folders.glob("*") if path.is_dir())
    if len(log_folders) == 1:
        return log_folders[0]
    problem = ", ".join(path.name for path in log_folders) or "no log"
    raise BadInput(
        folders, "the folder", problem, "SERIAL to say which" if log_folders else "a log"
    )


def parse_instant_ns(text: str) -> int:
    """Parse a time; without an offset it is UTC, as in all of armd; raises `BadInput`."""
    try:
        ns = round(float(text) * 1e9)
    except (ValueError, OverflowError):
        ns = _parse_calendar_ns(text)
    if abs(ns) < 1 << 63:
        return ns
    raise _make_instant_fault(text)


def _parse_calendar_ns(text: str) -> int:
    try:
        instant = datetime.datetime.fromisoformat(text)
        if instant.tzinfo is None:
            instant = instant.replace(tzinfo=datetime.UTC)
        return round(instant.timestamp() * 1e9)
    except (ValueError, OverflowError) as error:
        raise _make_instant_fault(text) from error


def _make_instant_fault(text: str) -> BadInput:
    expected = "a time as 2026-03-01T09:00:00Z, or Unix seconds"
    return BadInput("the command line", "--since", repr(text[:40]), expected)

"""`armd correct`: write readings with their corrected points, by the daemon's kernel."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from armd.compensation.data.correction.correction import Corrector
from armd.compensation.data.correction.files import correct_file
from armd.compensation.data.correction.point_columns import COLUMNS
from armd.compensation.data.tables.readings import read_header
from armd.compensation.data.tables.recorded import is_recorded
from armd.daemon.commands.offline.given import (
    add_arm,
    add_session_settings,
    find_session_settings,
    load_given,
)
from armd.errors import BadInput
from armd.files.outputs import POINTS, add_force, check_outputs
from armd.printable import to_printable
from armd.terminal.aside import make_aside, show_bar
from armd.terminal.counted import format_count
from armd.terminal.suggest import list_folder

#: Further remarks are only counted.
MOST_REMARKS = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("readings", type=Path, help="a .csv or .parquet file with columns q1 … qN")
    add_arm(parser)
    parser.add_argument("--calibration", metavar="CAL.json", help="without it: nominal, flag 7")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="POINTS.csv")
    add_session_settings(parser, "of q1 … qN")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    readings: Path = args.readings
    if readings.is_dir():
        expected = f".csv or .parquet{list_folder(readings)}"
        raise BadInput(readings, "the file", "a folder", expected)
    if readings.suffix not in (".csv", ".parquet"):
        raise BadInput(readings, "the file", f"a {readings.suffix} file", ".csv or .parquet")
    inputs = [readings, readings.parent / "session.toml", args.arm, args.calibration]
    check_outputs({"-o": (args.output, POINTS)}, inputs, args.force)
    arm, calibration = load_given(args)
    unit, started_unix_s = find_session_settings(readings, args.angle_unit, args.started)
    loaded = calibration.loaded if calibration else None
    corrector = Corrector(arm.content, loaded, unit, started_unix_s)
    header = read_header(readings)
    repeated = [name for name in COLUMNS if name in header]
    if repeated and not (readings.suffix == ".parquet" and is_recorded(header)):
        names = ", ".join(repeated)
        twice = f"armd: {readings}: has {names} already; the last of each is new"
        print(to_printable(twice), file=sys.stderr)
    with show_bar(make_aside(args), "correcting") as report_progress:
        n = correct_file(
            readings, args.output, corrector, lambda share: report_progress("correcting", share)
        )
    for remark in corrector.remarks[:MOST_REMARKS]:
        print(to_printable(f"armd: {remark}"), file=sys.stderr)
    if (n_omitted := len(corrector.remarks) - MOST_REMARKS) > 0:
        print(f"armd: {format_count(n_omitted, 'more remark')} of the same kind", file=sys.stderr)
    print(to_printable(f"{args.output}: {format_count(n, 'point')}"))
    return 0

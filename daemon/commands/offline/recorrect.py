"""`armd recorrect`: recompute measurements from their stored angles and temperatures."""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armd import Flag
from armd.arrays import F64
from armd.compensation.data.sessions.columns import LEAST_C, MOST_C
from armd.compensation.interim.recorrection.quality_page import Impact, render_quality_page
from armd.compensation.interim.recorrection.recorrect import Recorrected, correct_again
from armd.compensation.model.arm import Arm, Vector3, load_arm
from armd.compensation.model.calibration import LoadedCalibration, load_calibration
from armd.compensation.model.state import States
from armd.compensation.report.layout.written import add_pages, list_page_outputs, write_pages
from armd.daemon.bridges.export import source
from armd.daemon.bridges.export.source import MeasurementLine, Measurements
from armd.daemon.bridges.export.tables import compute_uncertainty_mm
from armd.daemon.commands.live.export import parse_instant_ns
from armd.daemon.commands.offline.given import add_arm
from armd.daemon.config import load_config
from armd.daemon.files.measurement_log import list_log_files
from armd.daemon.live.arm_in_use import replace_offset
from armd.errors import BadInput
from armd.files.outputs import OutputKind, add_force, check_outputs
from armd.files.writing import write_whole
from armd.terminal.aside import make_aside
from armd.terminal.counted import format_count

COLUMNS = (
    "seq", "stamp_ns", "x_old_mm", "y_old_mm", "z_old_mm", "x_new_mm", "y_new_mm", "z_new_mm",
    "dx_mm", "dy_mm", "dz_mm", "distance_mm", "at_most_mm",
    "u_x_old_mm", "u_y_old_mm", "u_z_old_mm", "u_x_new_mm", "u_y_new_mm", "u_z_new_mm",
    "flags_old", "flags_new", "calibration_old", "calibration_new", "tip", "matters",
)  # fmt: skip
#: Flags that depend on the calibration, and are computed again.
OF_CALIBRATION = sum(flag for flag in Flag if flag.origin == "calibration")
RECORRECTED = OutputKind(
    "measurements recorrected", lambda head: head.startswith(b"seq,stamp_ns,x_old")
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "measurements",
        nargs="+",
        type=Path,
        metavar="MEASUREMENTS",
        help="JSON lines, a measurement log's folder, a recording, or a CSV of `armd export`",
    )
    add_arm(parser)
    parser.add_argument(
        "--calibration", required=True, metavar="CAL.json", help="the calibration to correct with"
    )
    parser.add_argument(
        "--since", metavar="TIME", help="only later ones: 2026-03-01T09:00 (UTC), or Unix seconds"
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        metavar="MM",
        help="a measurement that moves by more than this matters",
    )
    parser.add_argument(
        "--config", metavar="armd.toml", help="whose [tips] the measurements name, if they do"
    )
    parser.add_argument(
        "--operator", metavar="NAME", help="who corrects again, as the report names them"
    )
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.csv")
    add_pages(parser, "a page for the quality file")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    if args.tolerance is not None and not 0 < args.tolerance < float("inf"):
        raise BadInput("the command line", "--tolerance", f"{args.tolerance:g}", "mm, above 0")
    check_outputs(
        {"-o": (args.output, RECORRECTED), **list_page_outputs(args)},
        [*args.measurements, args.arm, args.calibration, args.config],
        args.force,
    )
    since_ns = parse_instant_ns(args.since) if args.since else None
    arm = load_arm(args.arm)
    calibration = load_calibration(args.calibration, arm)
    with make_aside(args).status("reading the measurements …"):
        collections = [source.from_path(path) for path in args.measurements]
    nameless = sum(
        _count_nameless(path, collection, arm, args.arm)
        for path, collection in zip(args.measurements, collections, strict=True)
    )
    chosen = _choose_measurements(collections, since_ns)
    without = [m for m in chosen if m.angles_rad is None]
    chosen = [m for m in chosen if m.angles_rad is not None]
    location = ", ".join(map(str, args.measurements))
    with make_aside(args).status(f"correcting {format_count(len(chosen), 'measurement')} again …"):
        new = _recorrect_measurements(chosen, arm, calibration, _load_tips(args.config), location)
    old = np.array([m.position_mm or (np.nan,) * 3 for m in chosen]).reshape(-1, 3)
    distance = np.linalg.norm(new.position_mm - old, axis=1)
    change = Impact(
        arm.serial_number,
        calibration.sha256,
        [m.seq for m in chosen],
        [m.stamp_ns for m in chosen],
        distance,
        np.linalg.norm(new.uncertainty_mm, axis=1),
        args.tolerance,
        [m.calibration for m in chosen],
    )
    left_out = [sentence for collection in collections for sentence in collection.left_out]
    if without:
        none = format_count(len(without), "measurement")
        left_out.insert(0, f"{none} without angles left out (pressed while invalid)")
    if nameless:
        remark = (
            f"{format_count(nameless, 'measurement')} without the serial number of an arm (of an"
        )
        left_out.append(f"{remark} older armd) taken for {arm.serial_number}'s")
    write_whole(args.output, _write_table(chosen, old, new, change, calibration))
    celsius = [c for m in chosen for c in m.temperatures_c.values() if c is not None]
    write_pages(
        args,
        lambda: render_quality_page(change, _hash_inputs(args), left_out, args.operator, celsius),
    )
    print(f"armd: {args.output}: {change.in_words()}")
    for sentence in left_out:
        print(f"armd: {sentence}")
    return 0


def _count_nameless(path: Path, collection: Measurements, arm: Arm, arm_file: str) -> int:
    """Count measurements without an arm's serial number; raises `BadInput` for another arm's."""
    expected = f"{arm.serial_number}, as {arm_file} has"
    if collection.serial not in ("", arm.serial_number):
        raise BadInput(path, "the arm", collection.serial, expected)
    for m in collection.measurements:
        if m.serial not in (None, arm.serial_number):
            raise BadInput(path, f"serial of seq {m.seq}", m.serial, expected)
    return 0 if collection.serial else sum(m.serial is None for m in collection.measurements)


def _hash_inputs(args: argparse.Namespace) -> dict[str, str]:
    """Return the SHA-256 of every file read."""
    paths = [
        *args.measurements,
        *map(Path, filter(None, (args.arm, args.calibration, args.config))),
    ]
    files = [file for path in paths for file in (list_log_files(path) if path.is_dir() else [path])]
    hashes = {}
    for file in files:
        with file.open("rb") as data:
            hashes[str(file)] = hashlib.file_digest(data, "sha256").hexdigest()
    return hashes


def _choose_measurements(
    collections: Sequence[Measurements], since_ns: int | None
) -> list[MeasurementLine]:
    """Return the measurements of all sources from *since_ns* on, by time, each once."""
    by_time = {
        (m.stamp_ns, m.seq): m for collection in collections for m in collection.measurements
    }
    return [by_time[key] for key in sorted(by_time) if since_ns is None or key[0] >= since_ns]


def _load_tips(config: str | None) -> dict[str, Any]:
    return {} if config is None else dict(load_config(config).file.tips)


def _recorrect_measurements(
    chosen: Sequence[MeasurementLine],
    arm: Arm,
    calibration: LoadedCalibration,
    tips: dict[str, Any],
    location: str,
) -> Recorrected:
    """Recompute each measurement with the tip that it was measured with.

    The tip's offset is that of *tips*, else the one stored with the measurement.
    """
    states = _make_states(chosen, arm, location)
    position, uncertainty = np.full((2, len(chosen), 3), np.nan)
    flags = np.zeros(len(chosen), np.uint32)
    offsets = [_find_offset_mm(m, tips, location) for m in chosen]
    for offset in dict.fromkeys(offsets):
        with_tip: tuple[Arm, LoadedCalibration | None] = (arm, calibration)
        if offset is not None:
            with_tip = replace_offset(arm, calibration, offset)
        its_arm, its_calibration = with_tip
        assert its_calibration is not None
        rows = np.array([row_offset == offset for row_offset in offsets])
        # Correct all rows, because lags need the earlier ones; then keep those of this tip.
        recorrected = correct_again(its_arm, its_calibration, states)
        position[rows], uncertainty[rows] = (
            recorrected.position_mm[rows],
            recorrected.uncertainty_mm[rows],
        )
        flags[rows] = recorrected.flags[rows]
    return Recorrected(position, uncertainty, flags)


def _find_offset_mm(m: MeasurementLine, tips: dict[str, Any], location: str) -> Vector3 | None:
    """Return the offset of a measurement's tip; None means the calibration's own.

    Raises `BadInput` for an unknown tip.
    """
    if m.tip is None:
        return None
    if m.tip in tips:
        offset: Vector3 = tips[m.tip].offset_mm
        return offset
    if m.tip_offset_mm is None:
        expected = "--config with the armd.toml whose [tips] has it"
        raise BadInput(location, "tip", repr(m.tip), expected)
    return m.tip_offset_mm


def _make_states(chosen: Sequence[MeasurementLine], arm: Arm, location: str) -> States:
    n, joints = len(chosen), arm.n_joints
    unknown = [np.nan] * joints
    for m in chosen:
        for name, values in (("angles_rad", m.angles_rad), ("rates_rad_s", m.rates_rad_s)):
            if values is not None and len(values) != joints:
                problem = f"{len(values)} of seq {m.seq}"
                raise BadInput(
                    location, name, problem, f"{joints}, the joints of {arm.serial_number}"
                )
        if m.temperatures_c and (missing := set(arm.sensors) - set(m.temperatures_c)):
            sensor_names = ", ".join(m.temperatures_c)
            raise BadInput(
                location, f"temperature {min(missing)}", f"{sensor_names} of seq {m.seq}", "it"
            )
        for name, value in m.temperatures_c.items():
            if value is not None and not LEAST_C <= value <= MOST_C:
                expected = f"a temperature in °C, {LEAST_C:g} to {MOST_C:g}"
                raise BadInput(
                    location, f"temperature {name}", f"{value:g} of seq {m.seq}", expected
                )
    celsius = [[m.temperatures_c.get(name) for name in arm.sensors] for m in chosen]
    return States(
        q=np.array([m.angles_rad for m in chosen], float).reshape(n, joints),
        rate=np.array([m.rates_rad_s or unknown for m in chosen], float).reshape(n, joints),
        temperature_c=np.array(celsius, float).reshape(n, len(arm.sensors)),
        time_s=np.array([m.stamp_ns * 1e-9 for m in chosen]),
        approach=np.array([m.approach or (np.nan,) * 3 for m in chosen]).reshape(n, 3),
        series=np.zeros(n, np.int64),
    )


def _write_table(
    chosen: Sequence[MeasurementLine],
    old: F64,
    new: Recorrected,
    change: Impact,
    calibration: LoadedCalibration,
) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for i, m in enumerate(chosen):
        numbers = [
            *old[i], *new.position_mm[i], *(new.position_mm[i] - old[i]), change.distance_mm[i],
            change.at_most_mm[i], *compute_uncertainty_mm(m), *new.uncertainty_mm[i],
        ]  # fmt: skip
        writer.writerow(
            [
                m.seq,
                m.stamp_ns,
                *("" if np.isnan(value) else f"{value:.6f}" for value in numbers),
                # Flags that do not depend on the calibration hold for the new position, too.
                m.flags,
                int(new.flags[i]) | m.flags & ~OF_CALIBRATION,
                m.calibration or "",
                calibration.sha256[:16],
                m.tip or "",
                "" if change.tolerance_mm is None else int(change.matter[i]),
            ]
        )
    return text.getvalue()

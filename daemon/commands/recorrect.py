"""`armd recorrect`: measurements computed anew from their stored angles and temperatures."""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from armd import Flag
from armd.compensation.interim.recorrect import Recorrected, recorrect
from armd.compensation.interim.report import Change, quality_page
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import LoadedCalibration, load_calibration
from armd.compensation.model.state import States
from armd.daemon.bridges.export import source
from armd.daemon.bridges.export.source import Measured, Measurement
from armd.daemon.bridges.export.tables import uncertainty_mm
from armd.daemon.commands.export import instant_ns
from armd.daemon.config import load_config
from armd.daemon.live.arm_in_use import with_offset
from armd.errors import BadInput
from armd.files import write_whole
from armd.outputs import PAGE, Kind, add_force, check_outputs

F64 = npt.NDArray[np.float64]

COLUMNS = (
    "seq", "stamp_ns", "x_old_mm", "y_old_mm", "z_old_mm", "x_new_mm", "y_new_mm", "z_new_mm",
    "dx_mm", "dy_mm", "dz_mm", "distance_mm", "u_x_old_mm", "u_y_old_mm", "u_z_old_mm",
    "u_x_new_mm", "u_y_new_mm", "u_z_new_mm", "flags_old", "flags_new", "calibration_old",
    "calibration_new", "tip", "matters",
)  # fmt: skip
RECORRECTED = Kind("measurements recorrected", lambda head: head.startswith(b"seq,stamp_ns,x_old"))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "measurements",
        nargs="+",
        type=Path,
        metavar="MEASUREMENTS",
        help="JSON lines, a measurement log's folder, a recording, or a CSV of `armd export`",
    )
    parser.add_argument("--arm", required=True, metavar="ARM.toml", help="what the arm is")
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
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.csv")
    parser.add_argument("--report", type=Path, metavar="R.html", help="for the quality file")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    if args.tolerance is not None and not 0 < args.tolerance < float("inf"):
        raise BadInput("the command line", "--tolerance", f"{args.tolerance:g}", "mm, above 0")
    check_outputs(
        {"-o": (args.output, RECORRECTED), "--report": (args.report, PAGE)},
        [*args.measurements, args.arm, args.calibration, args.config],
        args.force,
    )
    since_ns = instant_ns(args.since) if args.since else None
    arm = load_arm(args.arm)
    calibration = load_calibration(args.calibration, arm)
    found = [source.from_path(path) for path in args.measurements]
    for path, one in zip(args.measurements, found, strict=True):
        if one.serial not in ("", arm.serial_number):
            raise BadInput(path, "the arm", one.serial, f"{arm.serial_number}, as {args.arm} has")
    chosen = _chosen(found, since_ns)
    without = [m for m in chosen if m.angles_rad is None]
    chosen = [m for m in chosen if m.angles_rad is not None]
    where = ", ".join(map(str, args.measurements))
    new = _recorrected(chosen, arm, calibration, _tips(args.config), where)
    old = np.array([m.position_mm or (np.nan,) * 3 for m in chosen]).reshape(-1, 3)
    distance = np.linalg.norm(new.position_mm - old, axis=1)
    matters = None if args.tolerance is None else distance > args.tolerance
    write_whole(args.output, _table(chosen, old, new, distance, matters, calibration))
    change = Change(
        arm.serial_number,
        calibration.sha256,
        [m.stamp_ns for m in chosen],
        distance,
        np.linalg.norm(new.uncertainty_mm, axis=1),
        args.tolerance,
    )
    if args.report:
        write_whole(args.report, quality_page(change, [str(path) for path in args.measurements]))
    print(f"armd: {args.output}: {change.in_words()}")
    if without:
        print(f"armd: {len(without)} measurements without angles left out (pressed while invalid)")
    for sentence in (sentence for one in found for sentence in one.left_out):
        print(f"armd: {sentence}")
    return 0


def _chosen(found: Sequence[Measured], since_ns: int | None) -> list[Measurement]:
    """Of all sources, by time, each once."""
    by_time = {(m.stamp_ns, m.seq): m for one in found for m in one.measurements}
    return [by_time[key] for key in sorted(by_time) if since_ns is None or key[0] >= since_ns]


def _tips(config: str | None) -> dict[str, Any]:
    return {} if config is None else dict(load_config(config).file.tips)


def _recorrected(
    chosen: Sequence[Measurement],
    arm: Arm,
    calibration: LoadedCalibration,
    tips: dict[str, Any],
    where: str,
) -> Recorrected:
    """Each with the tip it was measured with."""
    states = _states(chosen, arm, where)
    position, uncertainty = np.full((2, len(chosen), 3), np.nan)
    flags = np.zeros(len(chosen), np.uint32)
    for name in dict.fromkeys(m.tip for m in chosen):
        with_tip: tuple[Arm, LoadedCalibration | None] = (arm, calibration)
        if name is not None:
            if name not in tips:
                expected = "--config with the armd.toml whose [tips] has it"
                raise BadInput(where, "tip", repr(name), expected)
            with_tip = with_offset(arm, calibration, tips[name].offset_mm)
        its_arm, its_calibration = with_tip
        assert its_calibration is not None
        rows = np.array([m.tip == name for m in chosen])
        # All rows, for lags; then those of this tip.
        found = recorrect(its_arm, its_calibration, states)
        position[rows], uncertainty[rows] = found.position_mm[rows], found.uncertainty_mm[rows]
        flags[rows] = found.flags[rows]
    return Recorrected(position, uncertainty, flags)


def _states(chosen: Sequence[Measurement], arm: Arm, where: str) -> States:
    n, joints = len(chosen), arm.n_joints
    unknown = [np.nan] * joints
    for m in chosen:
        for name, values in (("angles_rad", m.angles_rad), ("rates_rad_s", m.rates_rad_s)):
            if values is not None and len(values) != joints:
                found = f"{len(values)} of seq {m.seq}"
                raise BadInput(where, name, found, f"{joints}, the joints of {arm.serial_number}")
        if m.temperatures_c and (missing := set(arm.sensors) - set(m.temperatures_c)):
            there = ", ".join(m.temperatures_c)
            raise BadInput(where, f"temperature {min(missing)}", f"{there} of seq {m.seq}", "it")
    celsius = [[m.temperatures_c.get(name) for name in arm.sensors] for m in chosen]
    return States(
        q=np.array([m.angles_rad for m in chosen], float).reshape(n, joints),
        rate=np.array([m.rates_rad_s or unknown for m in chosen], float).reshape(n, joints),
        temperature_c=np.array(celsius, float).reshape(n, len(arm.sensors)),
        time_s=np.array([m.stamp_ns * 1e-9 for m in chosen]),
        approach=np.array([m.approach or (np.nan,) * 3 for m in chosen]).reshape(n, 3),
        series=np.zeros(n, np.int64),
    )


def _table(
    chosen: Sequence[Measurement],
    old: F64,
    new: Recorrected,
    distance: F64,
    matters: npt.NDArray[np.bool_] | None,
    calibration: LoadedCalibration,
) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for i, m in enumerate(chosen):
        numbers = [
            *old[i], *new.position_mm[i], *(new.position_mm[i] - old[i]), distance[i],
            *uncertainty_mm(m), *new.uncertainty_mm[i],
        ]  # fmt: skip
        writer.writerow(
            [
                m.seq,
                m.stamp_ns,
                *("" if np.isnan(value) else f"{value:.6f}" for value in numbers),
                # What the measuring itself said of its points holds for the new position, too.
                m.flags,
                int(new.flags[i]) | m.flags & ~int(Flag.TEMPERATURE_RANGE | Flag.NOT_CALIBRATED),
                m.calibration or "",
                calibration.sha256[:16],
                m.tip or "",
                "" if matters is None else int(matters[i]),
            ]
        )
    return text.getvalue()

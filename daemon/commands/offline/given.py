"""Shared options of offline commands: arm, calibration, and settings of a table of readings."""

from __future__ import annotations

import argparse
from pathlib import Path

from armd.compensation.data.sessions.format import AngleUnit, SessionFile
from armd.files.schema import load_toml
from armd.offline.arm_model import ArmModel, read_arm
from armd.offline.calibration import Calibration, read_calibration
from armd.offline.corrector import parse_instant


def add_arm(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arm", required=True, metavar="ARM.toml", help="what the arm is")


def add_model_under_test(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--calibration",
        metavar="CAL.json",
        help="the model under test, held; default: what `armd calibrate` makes of the sessions",
    )


def load_given(args: argparse.Namespace) -> tuple[ArmModel, Calibration | None]:
    """Load the files of `--arm` and `--calibration`; raises `BadInput`."""
    arm = read_arm(args.arm)
    if not args.calibration:
        return arm, None
    calibration = read_calibration(args.calibration)
    calibration.for_arm(arm.content)
    return arm, calibration


def add_session_settings(parser: argparse.ArgumentParser, of_angles: str) -> None:
    """Add options that replace a session.toml's; see `find_session_settings`."""
    parser.add_argument(
        "--started", metavar="ISO", help="instant of time_s = 0, with its offset from UTC"
    )
    parser.add_argument(
        "--angle-unit",
        choices=["rad", "deg", "count"],
        help=f"{of_angles}; otherwise as session.toml beside the table says, or rad",
    )


def find_session_settings(
    readings: Path, unit: AngleUnit | None, started: str | None
) -> tuple[AngleUnit, float | None]:
    """Return the angle unit and the start (Unix s) of the readings.

    The command line's values come first, then those of session.toml beside the readings.
    """
    session_file = readings.parent / "session.toml"
    session = load_toml(session_file, SessionFile) if session_file.exists() else None
    if started is not None:
        started_unix_s: float | None = parse_instant("--started", started, "the command line")
    else:
        started_unix_s = session.started.timestamp() if session else None
    return unit or (session.angle_unit if session else "rad"), started_unix_s

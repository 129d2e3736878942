"""The arm, and the calibration if there is one, that an offline command is given."""

from __future__ import annotations

import argparse

from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import LoadedCalibration, load_calibration


def add_arm(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arm", required=True, metavar="ARM.toml", help="what the arm is")


def add_model_under_test(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--calibration",
        metavar="CAL.json",
        help="the model under test, held; default: what `armd calibrate` makes of the sessions",
    )


def load_given(args: argparse.Namespace) -> tuple[Arm, LoadedCalibration | None]:
    """Of `--arm` and `--calibration`; raises `BadInput`."""
    arm = load_arm(args.arm)
    return arm, load_calibration(args.calibration, arm) if args.calibration else None

"""The arm, and the calibration if there is one, that an offline command is given."""

from __future__ import annotations

import argparse

from armd.offline.arm_model import ArmModel, read_arm
from armd.offline.calibration import Calibration, read_calibration


def add_arm(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--arm", required=True, metavar="ARM.toml", help="what the arm is")


def add_model_under_test(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--calibration",
        metavar="CAL.json",
        help="the model under test, held; default: what `armd calibrate` makes of the sessions",
    )


def load_given(args: argparse.Namespace) -> tuple[ArmModel, Calibration | None]:
    """Of `--arm` and `--calibration`; raises `BadInput`."""
    arm = read_arm(args.arm)
    if not args.calibration:
        return arm, None
    calibration = read_calibration(args.calibration)
    calibration.for_arm(arm.content)
    return arm, calibration

"""The reports of results. This module loads the drawings, which is slow."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.report.calibration.page import make_calibration_report
from armd.compensation.report.layout.about import About
from armd.compensation.report.sessions import InputFile
from armd.offline.arm_model import ArmModel
from armd.offline.results.identified import Identified


def draw_calibration_page(
    identified: Identified, written: LoadedCalibration, about: About | None = None
) -> str:
    """Return the report of a calibration, *written* to a file or not."""
    return make_calibration_report(
        identified.result, identified.sessions, describe_arm(identified.arm), written, about
    )


def list_inputs(
    arm: ArmModel, calibration: LoadedCalibration | None
) -> dict[str, InputFile | None]:
    """Return the inputs that a report names beside sessions."""
    calibration_file = InputFile(calibration.path.name, calibration.sha256) if calibration else None
    return {"arm": describe_arm(arm), "calibration": calibration_file}


def describe_arm(arm: ArmModel) -> InputFile:
    """Return an arm.toml as an input of a report."""
    return InputFile(arm.path.name, arm.sha256)


def hash_data(name: str, content: dict[str, Any]) -> InputFile:
    """Return data without a file as an input of a report, with the SHA-256 of its JSON."""
    text = json.dumps(content, sort_keys=True)
    return InputFile(name, hashlib.sha256(text.encode()).hexdigest())

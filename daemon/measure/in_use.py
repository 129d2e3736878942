"""The daemon's arm, calibration and tip, and their files for a result."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armd.arrays import F64
from armd.client import Arm as Connection
from armd.compensation.model.arm import Arm, Vector3
from armd.compensation.model.calibration import (
    Calibration,
    parse_calibration,
    save_calibration,
)
from armd.compensation.model.parameters import TIP_PARAMETERS
from armd.errors import ArmdError
from armd.files.schema import validate
from armd.files.toml_text import format_toml
from armd.files.writing import write_whole

ARM, CALIBRATION = "arm.toml", "calibration_in_use.json"


@dataclass(frozen=True)
class MeasuredWith:
    """The arm, calibration and tip of a measurement.

    The tip's offset and radius are already those of the tip in use.
    """

    arm: Arm
    calibration: Calibration | None  # None: nominal geometry
    identity: str | None  # of the calibration's file, as measurements carry it
    tip: str | None  # a name of [tips]; None: the calibration's own
    data: bytes | None = None  # the calibration's file, where the tip is its own

    @property
    def constants(self) -> F64:
        """The parameter vector (5 N + 9,), tip included."""
        if self.calibration is None:
            return self.arm.nominal()
        return self.calibration.vector(self.arm.n_joints)

    @property
    def offset_mm(self) -> F64:
        return self.constants[self.arm.layout.tip]

    def write(self, folder: Path) -> tuple[Path, Path | None]:
        """Write arm.toml and, if there is one, the calibration, for commands to read."""
        write_whole(folder / ARM, write_arm_toml(self.arm))
        if self.calibration is None:
            return folder / ARM, None
        if self.data is not None:
            write_whole(folder / CALIBRATION, self.data)
        else:
            save_calibration(folder / CALIBRATION, self.calibration)
        return folder / ARM, folder / CALIBRATION


def get_in_use(connection: Connection) -> MeasuredWith:
    """Ask a running daemon for its arm, calibration and tip.

    Raises `ArmdError` for an invalid answer.
    """
    info, text = connection.info(), connection.calibration_file()
    try:
        return read_in_use(info, text)
    except (KeyError, TypeError, ValueError) as error:
        raise ArmdError(f"{connection.serial}: the answer is none of armd's: {error!r}") from error


def read_in_use(info: Mapping[str, Any], calibration_text: str | None) -> MeasuredWith:
    """Read the daemon's `info` and its calibration file; raises `BadInput`."""
    arm = validate("the daemon's info", info["arm"], Arm)
    calibration, identity, data = None, None, None
    if calibration_text is not None:
        data = calibration_text.encode()
        calibration = parse_calibration("the daemon's calibration", data)
        identity = hashlib.sha256(data).hexdigest()[:16]
    tip = info["tip"]
    if tip is not None:
        tip_settings = info["configuration"]["tips"][tip]
        radius_mm = tip_settings.get("radius_mm")
        radius_mm = arm.tip.radius_mm if radius_mm is None else radius_mm
        arm, calibration = _with_tip(arm, calibration, tuple(tip_settings["offset_mm"]), radius_mm)
        data = None
    return MeasuredWith(arm, calibration, identity, tip, data)


def _with_tip(
    arm: Arm, calibration: Calibration | None, offset_mm: Vector3, radius_mm: float
) -> tuple[Arm, Calibration | None]:
    tip = arm.tip.model_copy(update={"offset_mm": offset_mm, "radius_mm": radius_mm})
    arm = arm.model_copy(update={"tip": tip})
    if calibration is None:
        return arm, None
    offsets = dict(zip(TIP_PARAMETERS, offset_mm, strict=True))
    constants = {**calibration.constants, **offsets}
    return arm, calibration.model_copy(update={"constants": constants})


def write_arm_toml(arm: Arm) -> str:
    """Return the text of an arm.toml."""
    return format_toml(arm.model_dump(mode="json", by_alias=True, exclude_none=True))

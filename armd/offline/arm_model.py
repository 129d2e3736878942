"""`read_arm`: the model of an arm, before anything is measured."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

from armd.compensation.model.arm import Arm
from armd.files.inputs import MOST_TOML_BYTES, read_input
from armd.files.schema import decode_toml, parse_toml
from armd.files.writing import write_whole
from armd.offline.results.display import Displayed, Facts

PathText = str | os.PathLike[str]


class ArmModel(Displayed):
    """The content of an arm.toml, checked. `read_arm` makes it; it does not change.

    (`armd.Arm` is something else: a connection to a running arm.)
    """

    def __init__(self, path: Path, data: bytes) -> None:
        self._path = path
        self._data = data
        #: the checked file in the form of armd's own functions; not public
        self.content = parse_toml(path, data, Arm)

    @property
    def path(self) -> Path:
        """The file from which it was read."""
        return self._path

    @property
    def sha256(self) -> str:
        """SHA-256 of the file's bytes, hexadecimal."""
        return hashlib.sha256(self._data).hexdigest()

    @property
    def serial_number(self) -> str:
        """The arm's serial number."""
        return self.content.serial_number

    @property
    def n_joints(self) -> int:
        """The number of joints, N."""
        return self.content.n_joints

    @property
    def sensors(self) -> list[str]:
        """Names of the temperature sensors, in the order of a *temperatures* array's columns."""
        return self.content.sensors

    def to_dict(self) -> dict[str, Any]:
        """Return the file's content as plain data, as `tomllib` reads it."""
        return decode_toml(self._path, self._data)

    def save(self, path: PathText) -> None:
        """Write the arm.toml, byte by byte as it was read.

        The file appears completely or not at all; an existing one is replaced. Raises
        `armd.BadInput` where nothing can be written.
        """
        write_whole(Path(path), self._data)

    def _describe(self) -> tuple[str, Facts]:
        arm = self.content
        tip = ", ".join(f"{value:g}" for value in arm.tip.offset_mm)
        facts = [
            ("file", str(self._path)),
            ("joints", str(arm.n_joints)),
            ("reach", f"{arm.reach_mm:.0f} mm"),
            ("temperature sensors", ", ".join(arm.sensors) or "none"),
            ("reference temperature", f"{arm.reference_temperature_c:g} °C"),
            ("tip", f"{tip} mm, radius {arm.tip.radius_mm:g} mm"),
        ]
        return f"Arm {arm.serial_number}", facts


def read_arm(path: PathText) -> ArmModel:
    """Read and check an arm.toml.

    Raises `armd.BadInput` naming file, key, found and expected values.

    >>> arm = armd.read_arm("measured/arm.toml")
    >>> arm.n_joints
    6
    """
    return ArmModel(Path(path), read_input(Path(path), MOST_TOML_BYTES))


def resolve_arm(arm: ArmModel | PathText) -> ArmModel:
    """Return *arm*, or the arm read from it if it is a path."""
    return arm if isinstance(arm, ArmModel) else read_arm(arm)

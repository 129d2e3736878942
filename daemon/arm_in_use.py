"""Which arm, calibration and tip the points are made with, and how that changes while running."""

from __future__ import annotations

import math
from dataclasses import replace

from armd.compensation.arm import Arm, Vector3
from armd.compensation.calibration import LoadedCalibration, load_calibration
from armd.compensation.parameters import TIP_PARAMETERS
from armd.daemon.config import Config
from armd.daemon.pipeline import Pipeline
from armd.errors import ArmdError


class ArmInUse:
    """Owns the pipeline; a change takes effect whole, between two samples, or not at all."""

    def __init__(self, config: Config) -> None:
        """Raises `BadInput` for a calibration that cannot be used."""
        self._config = config
        self.calibration = self._load()
        self.tip: str | None = None  # a name of [tips]; None: the calibration's own tip
        self.pipeline = Pipeline(config.arm, self.calibration, config.file.limits)

    def reload(self) -> str | None:
        """Read the calibration file again; returns a warning if the tip moved far.

        Raises `BadInput` and changes nothing if the file is bad.
        """
        return self._change(self._load(), self.tip)

    def select_tip(self, name: str) -> str | None:
        """Use a tip of [tips], or with "" the calibration's own; returns a warning as `reload`.

        Raises `ArmdError` for a name that is not configured.
        """
        tips = self._config.file.tips
        if name and name not in tips:
            raise ArmdError(f"no tip {name!r}; there are: {', '.join(tips) or 'none'}")
        return self._change(self.calibration, name or None)

    def _load(self) -> LoadedCalibration | None:
        path = self._config.calibration
        return None if path is None else load_calibration(path, self._config.arm)

    def _change(self, calibration: LoadedCalibration | None, tip: str | None) -> str | None:
        moved_mm = math.dist(
            self._offset_mm(self.calibration, self.tip), self._offset_mm(calibration, tip)
        )
        offset_mm = None if tip is None else self._offset_mm(calibration, tip)
        self.pipeline.use(*self._with_tip(calibration, offset_mm))
        self.calibration, self.tip = calibration, tip
        limit_mm = self._config.file.limits.tip_offset_mm
        if moved_mm <= limit_mm:
            return None
        return f"the tip's offset moved by {moved_mm:.3f} mm, more than {limit_mm:g} mm"

    def _offset_mm(self, calibration: LoadedCalibration | None, tip: str | None) -> Vector3:
        if tip is not None:
            return self._config.file.tips[tip].offset_mm
        if calibration is None:
            return self._config.arm.tip.offset_mm
        x, y, z = (calibration.content.constants[name] for name in TIP_PARAMETERS)
        return x, y, z

    def _with_tip(
        self, calibration: LoadedCalibration | None, offset_mm: Vector3 | None
    ) -> tuple[Arm, LoadedCalibration | None]:
        """Arm and calibration with another tip's offset in place of their own."""
        arm = self._config.arm
        if offset_mm is None:
            return arm, calibration
        tip = arm.tip.model_copy(update={"offset_mm": offset_mm})
        arm = arm.model_copy(update={"tip": tip})
        if calibration is None:
            return arm, None
        offsets = dict(zip(TIP_PARAMETERS, offset_mm, strict=True))
        constants = {**calibration.content.constants, **offsets}
        content = calibration.content.model_copy(update={"constants": constants})
        return arm, replace(calibration, content=content)

"""Which arm, calibration and tip the points are made with, and how that changes while running."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from armd.compensation.model.arm import Arm, Vector3
from armd.compensation.model.calibration import LoadedCalibration, load_calibration
from armd.compensation.model.parameters import TIP_PARAMETERS
from armd.daemon.config import Config
from armd.daemon.live.pipeline import Pipeline, Prepared
from armd.errors import ArmdError, BadInput


class InUse(NamedTuple):
    """What a point was made with."""

    calibration: LoadedCalibration | None  # None: nominal geometry
    tip: str | None  # a name of [tips]; None: the calibration's own tip


class Change(NamedTuple):
    """Another calibration or tip, ready to be taken over."""

    to: InUse
    prepared: Prepared
    warning: str | None  # where the tip moves far


class ArmInUse:
    """Owns the pipeline. A change is prepared in any thread, one at a time, while points are made;
    it takes effect whole, between two samples, or not at all."""

    def __init__(self, config: Config) -> None:
        """Raises `BadInput` for a calibration that cannot be used."""
        self._config = config
        calibration = self._load()
        self.in_use = InUse(calibration, None)
        self.pipeline = Pipeline(config.arm, calibration, config.file.limits)

    @property
    def calibration(self) -> LoadedCalibration | None:
        return self.in_use.calibration

    @property
    def tip(self) -> str | None:
        return self.in_use.tip

    def reloaded(self) -> Change:
        """The calibration file, read again; raises `BadInput` if it is bad."""
        return self._change(InUse(self._load(), self.tip))

    def with_tip(self, name: str) -> Change:
        """A tip of [tips], or with "" the calibration's own; raises `ArmdError` for a name that is
        not configured."""
        tips = self._config.file.tips
        if name and name not in tips:
            raise ArmdError(f"no tip {name!r}; there are: {', '.join(tips) or 'none'}")
        return self._change(InUse(self.calibration, name or None))

    def take(self, change: Change) -> None:
        """From the next sample on."""
        self.pipeline.use(change.prepared)
        self.in_use = change.to

    def _load(self) -> LoadedCalibration | None:
        path = self._config.calibration
        return None if path is None else load_calibration(path, self._config.arm)

    def _change(self, to: InUse) -> Change:
        moved_mm = math.dist(self._offset_mm(self.in_use), self._offset_mm(to))
        arm, calibration = self._config.arm, to.calibration
        if to.tip is not None:
            arm, calibration = with_offset(arm, calibration, self._offset_mm(to))
        try:
            prepared = self.pipeline.prepare(arm, calibration)
        except (ArithmeticError, MemoryError, ValueError) as error:  # numbers beyond all reason
            path = self._config.calibration or self._config.path
            found = f"numbers no model can be made of ({error})"
            raise BadInput(path, "the file", found, "an arm's calibration") from error
        limit_mm = self._config.file.limits.tip_offset_mm
        warning = f"the tip's offset moved by {moved_mm:.3f} mm, more than {limit_mm:g} mm"
        return Change(to, prepared, warning if moved_mm > limit_mm else None)

    def _offset_mm(self, in_use: InUse) -> Vector3:
        calibration, tip = in_use
        if tip is not None:
            return self._config.file.tips[tip].offset_mm
        if calibration is None:
            return self._config.arm.tip.offset_mm
        x, y, z = (calibration.content.constants[name] for name in TIP_PARAMETERS)
        return x, y, z


def with_offset(
    arm: Arm, calibration: LoadedCalibration | None, offset_mm: Vector3
) -> tuple[Arm, LoadedCalibration | None]:
    """Arm and calibration with another tip's offset in place of their own."""
    tip = arm.tip.model_copy(update={"offset_mm": offset_mm})
    arm = arm.model_copy(update={"tip": tip})
    if calibration is None:
        return arm, None
    offsets = dict(zip(TIP_PARAMETERS, offset_mm, strict=True))
    constants = {**calibration.content.constants, **offsets}
    content = calibration.content.model_copy(update={"constants": constants})
    return arm, replace(calibration, content=content)

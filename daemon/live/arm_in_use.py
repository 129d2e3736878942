"""The arm, calibration and tip in use for points, and their change while running."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from armd.compensation.model.arm import Arm, Vector3
from armd.compensation.model.calibration import LoadedCalibration, load_calibration
from armd.compensation.model.parameters import TIP_PARAMETERS
from armd.daemon.config import Config, Tip
from armd.daemon.files.kept_tips import keep_tip, load_active_tips
from armd.daemon.live.pipeline import Pipeline, Prepared
from armd.errors import ArmdError, BadInput, shorten_text


class InUse(NamedTuple):
    """The calibration and the tip of a point."""

    calibration: LoadedCalibration | None  # None: nominal geometry
    tip: str | None  # one of `tips`; None: the calibration's own tip
    tips: Mapping[str, Tip]  # those to choose from


class Takeover(NamedTuple):
    """Another calibration or tip, prepared for use."""

    to: InUse
    prepared: Prepared
    warning: str | None  # where the tip moves far


class ArmInUse:
    """Owns the pipeline, and changes its calibration or tip.

    Any thread may prepare a change, one at a time, while points are made. The change takes effect
    as a whole between two samples, or not at all.
    """

    def __init__(self, config: Config) -> None:
        """Load the calibration and the tips.

        Raises `BadInput` for an unusable calibration, or for damaged stored tips.
        """
        self._config = config
        calibration = self._load()
        tips = load_active_tips(config.arm.serial_number, config.file.tips)
        self.in_use = InUse(calibration, None, tips)
        self.pipeline = Pipeline(config.arm, calibration, config.file.limits)

    @property
    def calibration(self) -> LoadedCalibration | None:
        return self.in_use.calibration

    @property
    def tip(self) -> str | None:
        return self.in_use.tip

    @property
    def own_tip(self) -> Tip:
        """The calibration's own tip, or arm.toml's without a calibration."""
        offset_mm = self._offset_mm(InUse(self.calibration, None, {}))
        return Tip(offset_mm=offset_mm, radius_mm=self._config.arm.tip.radius_mm)

    @property
    def tip_in_use(self) -> Tip:
        """The active tip with its radius, which may be arm.toml's."""
        if self.tip is None:
            return self.own_tip
        tip = self.in_use.tips[self.tip]
        has_radius = tip.radius_mm is not None
        return tip if has_radius else tip.model_copy(update={"radius_mm": self.own_tip.radius_mm})

    def prepare_calibration_again(self) -> Takeover:
        """Load the calibration file again and prepare it; raises `BadInput` if it is bad."""
        return self._change(self.in_use._replace(calibration=self._load()))

    def prepare_tip(self, name: str) -> Takeover:
        """Prepare one of the tips, or with "" the calibration's own.

        Raises `ArmdError` for an unknown name.
        """
        tips = self.in_use.tips
        if name and name not in tips:
            raise ArmdError(
                f"no tip {shorten_text(name)!r}; there are: {', '.join(tips) or 'none'}"
            )
        return self._change(self.in_use._replace(tip=name or None))

    def store_and_prepare_tip(self, name: str, tip: Tip) -> Takeover:
        """Prepare a tip that was calibrated now, and store it for later starts.

        Raises `BadInput` where it cannot be used or stored.
        """
        before = self.in_use.tips.get(name)
        change = self._change(InUse(self.calibration, name, {**self.in_use.tips, name: tip}))
        keep_tip(self._config.arm.serial_number, name, tip, self._config.file.tips)
        if before is None:
            return change
        moved_mm = math.dist(before.offset_mm, tip.offset_mm)
        return change._replace(warning=self._warning(f"the tip {name!r}", moved_mm))

    def take(self, change: Takeover) -> None:
        """Use a prepared change from the next sample on."""
        self.pipeline.use(change.prepared)
        self.in_use = change.to

    def _load(self) -> LoadedCalibration | None:
        path = self._config.calibration
        return None if path is None else load_calibration(path, self._config.arm)

    def _change(self, to: InUse) -> Takeover:
        moved_mm = math.dist(self._offset_mm(self.in_use), self._offset_mm(to))
        arm, calibration = self._config.arm, to.calibration
        if to.tip is not None:
            arm, calibration = replace_offset(arm, calibration, self._offset_mm(to))
        try:
            prepared = self.pipeline.prepare(arm, calibration)
        except (ArithmeticError, MemoryError, ValueError) as error:  # numbers too large
            path = self._config.calibration or self._config.path
            problem = f"numbers no model can be made of ({error})"
            raise BadInput(path, "the file", problem, "an arm's calibration") from error
        return Takeover(to, prepared, self._warning("the tip's offset", moved_mm))

    def _warning(self, subject: str, moved_mm: float) -> str | None:
        limit_mm = self._config.file.limits.tip_offset_mm
        text = f"{subject} moved by {moved_mm:.3f} mm, more than {limit_mm:g} mm"
        return text if moved_mm > limit_mm else None

    def _offset_mm(self, in_use: InUse) -> Vector3:
        calibration, tip, tips = in_use
        if tip is not None:
            return tips[tip].offset_mm
        if calibration is None:
            return self._config.arm.tip.offset_mm
        x, y, z = (calibration.content.constants[name] for name in TIP_PARAMETERS)
        return x, y, z


def replace_offset(
    arm: Arm, calibration: LoadedCalibration | None, offset_mm: Vector3
) -> tuple[Arm, LoadedCalibration | None]:
    """Return arm and calibration with another offset of the tip."""
    tip = arm.tip.model_copy(update={"offset_mm": offset_mm})
    arm = arm.model_copy(update={"tip": tip})
    if calibration is None:
        return arm, None
    offsets = dict(zip(TIP_PARAMETERS, offset_mm, strict=True))
    constants = {**calibration.content.constants, **offsets}
    content = calibration.content.model_copy(update={"constants": constants})
    return arm, replace(calibration, content=content)

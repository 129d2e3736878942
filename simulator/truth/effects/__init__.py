"""Physical imperfections of the arm, one file each, by exact physics."""

from armd.simulator.truth.effects.base import Effect
from armd.simulator.truth.effects.bending_link import BendingLink
from armd.simulator.truth.effects.bending_stylus import BendingStylus
from armd.simulator.truth.effects.bowing_link import BowingLink
from armd.simulator.truth.effects.distorted import Distorted
from armd.simulator.truth.effects.drifting import (
    DriftingLength,
    DriftingMount,
    DriftingTwist,
    DriftingZero,
)
from armd.simulator.truth.effects.eccentric_disc import EccentricDisc
from armd.simulator.truth.effects.expanding_link import ExpandingLink
from armd.simulator.truth.effects.foreign import (
    CablePull,
    CoupledHysteresis,
    DrivenByRate,
    LettingGo,
    ThermalEccentricity,
)
from armd.simulator.truth.effects.interpolation import Interpolation
from armd.simulator.truth.effects.knocked_joint import KnockedJoint
from armd.simulator.truth.effects.late_latch import LateLatch
from armd.simulator.truth.effects.lost_index import LostIndex
from armd.simulator.truth.effects.moving_mount import MovingMount
from armd.simulator.truth.effects.oval_disc import OvalDisc
from armd.simulator.truth.effects.play import Play
from armd.simulator.truth.effects.refitted_tip import RefittedTip
from armd.simulator.truth.effects.soft_joint import SoftJoint
from armd.simulator.truth.effects.square_wave import SquareWave
from armd.simulator.truth.effects.stretched_tape import StretchedTape
from armd.simulator.truth.effects.track_curve import TrackCurve
from armd.simulator.truth.effects.warm_housing import WarmHousing
from armd.simulator.truth.effects.wobbling_axis import WobblingAxis

__all__ = [
    "BendingLink",
    "BendingStylus",
    "BowingLink",
    "CablePull",
    "CoupledHysteresis",
    "Distorted",
    "DriftingLength",
    "DriftingMount",
    "DriftingTwist",
    "DriftingZero",
    "DrivenByRate",
    "EccentricDisc",
    "Effect",
    "ExpandingLink",
    "Interpolation",
    "KnockedJoint",
    "LateLatch",
    "LettingGo",
    "LostIndex",
    "MovingMount",
    "OvalDisc",
    "Play",
    "RefittedTip",
    "SoftJoint",
    "SquareWave",
    "StretchedTape",
    "ThermalEccentricity",
    "TrackCurve",
    "WarmHousing",
    "WobblingAxis",
]

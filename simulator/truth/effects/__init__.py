"""Physical imperfections of the arm, one file each, by exact physics."""

from armd.simulator.truth.effects.distorted import Distorted
from armd.simulator.truth.effects.drifting import (
    DriftingLength,
    DriftingMount,
    DriftingTwist,
    DriftingZero,
)
from armd.simulator.truth.effects.effect import Effect
from armd.simulator.truth.effects.encoder.eccentric_disc import EccentricDisc
from armd.simulator.truth.effects.encoder.interpolation import Interpolation
from armd.simulator.truth.effects.encoder.late_latch import LateLatch
from armd.simulator.truth.effects.encoder.lost_index import LostIndex
from armd.simulator.truth.effects.encoder.oval_disc import OvalDisc
from armd.simulator.truth.effects.encoder.square_wave import SquareWave
from armd.simulator.truth.effects.encoder.stretched_tape import StretchedTape
from armd.simulator.truth.effects.encoder.track_curve import TrackCurve
from armd.simulator.truth.effects.foreign import (
    Bristles,
    CablePull,
    CoupledHysteresis,
    CreepingPlay,
    DrivenByRate,
    LettingGo,
    TwoWheels,
    WideHysteresis,
)
from armd.simulator.truth.effects.mechanical.bending_link import BendingLink
from armd.simulator.truth.effects.mechanical.bending_stylus import BendingStylus
from armd.simulator.truth.effects.mechanical.knocked_joint import KnockedJoint
from armd.simulator.truth.effects.mechanical.meshing_gears import MeshingGears
from armd.simulator.truth.effects.mechanical.play import Play
from armd.simulator.truth.effects.mechanical.sagging_stylus import SaggingStylus
from armd.simulator.truth.effects.mechanical.soft_joint import SoftJoint
from armd.simulator.truth.effects.mechanical.wobbling_axis import WobblingAxis
from armd.simulator.truth.effects.setup.moving_mount import MovingMount
from armd.simulator.truth.effects.setup.refitted_tip import RefittedTip
from armd.simulator.truth.effects.thermal.bowing_link import BowingLink
from armd.simulator.truth.effects.thermal.expanding_link import ExpandingLink
from armd.simulator.truth.effects.thermal.warm_disc import WarmDisc
from armd.simulator.truth.effects.thermal.warm_from_work import WarmFromWork, WarmNeighbour
from armd.simulator.truth.effects.thermal.warm_housing import WarmHousing

__all__ = [
    "BendingLink",
    "BendingStylus",
    "BowingLink",
    "Bristles",
    "CablePull",
    "CoupledHysteresis",
    "CreepingPlay",
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
    "MeshingGears",
    "MovingMount",
    "OvalDisc",
    "Play",
    "RefittedTip",
    "SaggingStylus",
    "SoftJoint",
    "SquareWave",
    "StretchedTape",
    "TrackCurve",
    "TwoWheels",
    "WarmDisc",
    "WarmFromWork",
    "WarmHousing",
    "WarmNeighbour",
    "WideHysteresis",
    "WobblingAxis",
]

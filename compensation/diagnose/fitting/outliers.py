"""Single rests that belong to no effect, judged by the rule that `armd calibrate` judges by."""

from __future__ import annotations

from armd.arrays import I64
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.estimate.regions import find_regions
from armd.compensation.estimate.robust import DOWNWEIGHT_CHI2, find_far_off, select_outliers


def find_outliers(current: Fit) -> tuple[I64, float]:
    """Rests gone wrong, and the smallest family-wise p."""
    rests = current.linear.rests
    squares = current.noise.squares(current.rest_residual_mm)
    region = find_regions(find_far_off(squares, DOWNWEIGHT_CHI2), rests.observations.states.q)
    return select_outliers(squares, region)

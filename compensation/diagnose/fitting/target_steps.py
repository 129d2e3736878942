"""What is left, placement by placement and target by target: does one stand apart in itself?

A seat that moved, an artefact knocked or a joint that slipped half-way through the readings of one
target shows as a step between the first of them and the others, whatever the clock says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from armd.arrays import F64
from armd.compensation.diagnose.constants import LEAST_PART, LEAST_SQUARE, STEP_P
from armd.compensation.diagnose.problem.fitted import Fit


@dataclass(frozen=True)
class TargetStep:
    """What is left of the rests at one target in one placement, in the order of the readings."""

    placement: str
    target: str
    rests: int
    rms_um: float  # 3-D
    step_um: float  # between the mean of the first rests and that of the others, the clearest
    after: int  # how many the first are; 0: too few rests for a step
    step_p: float  # chance that the scatter about the two means makes a step as clear anywhere


def measure_target_steps(last: Fit) -> list[TargetStep]:
    """One entry per placement and target."""
    observations = last.linear.rests.points
    residual_um, normal = 1e3 * last.point_residual_mm, last.linear.normal
    pairs = np.stack([observations.placement, observations.target], axis=1)
    entries = []
    named, group = np.unique(pairs, axis=0, return_inverse=True)
    rests = np.argsort(group.ravel(), kind="stable")
    ends = np.cumsum(np.bincount(group.ravel(), minlength=len(named)))
    for (placement, target), numbers in zip(named, np.split(rests, ends[:-1]), strict=True):
        deviations = residual_um[numbers]
        if normal is not None and normal[numbers[0]].any():  # of a surface, along its normal
            deviations = np.einsum("ni,ni->n", deviations, normal[numbers])[:, None]
        step_um, after, step_p = _clearest_step(deviations)
        entries.append(
            TargetStep(
                observations.placement_names[placement],
                observations.target_names[target],
                len(deviations),
                float(np.sqrt((deviations**2).sum(axis=1).mean())),
                step_um,
                after,
                step_p,
            )
        )
    return entries


def select_significant_steps(entries: list[TargetStep]) -> list[TargetStep]:
    """Those with a step that their own scatter does not explain; a single target's is the arm's or
    the base's, and for the search to find."""
    return [entry for entry in entries if len(entries) > 1 and len(entries) * entry.step_p < STEP_P]


def _clearest_step(deviations: F64) -> tuple[float, int, float]:
    """Of (n, c) what is left in c directions, 3 or 1, over all ways to part the first from the
    others: size of the step, after how many, and its p value.

    By the scatter about the two means (Hotelling's test with equal variances): what is left at
    other targets says nothing of this one, and a step half-way through inflates its whole RMS.
    """
    n = len(deviations)
    if n < 2 * LEAST_PART:
        return 0.0, 0, 1.0
    after = np.arange(LEAST_PART, n - LEAST_PART + 1)
    sums = np.cumsum(deviations, axis=0)
    first = sums[after - 1] / after[:, None]
    second = (sums[-1] - sums[after - 1]) / (n - after)[:, None]
    squared_step = ((second - first) ** 2).sum(axis=1)
    between = after * (n - after) / n * squared_step
    within = np.maximum((deviations**2).sum() - (sums[-1] ** 2).sum() / n - between, LEAST_SQUARE)
    c = deviations.shape[1]
    freedom = c * (n - 2)
    p = fdtrc(c, freedom, (between / c) / (within / freedom))
    clearest = int(np.argmin(p))
    chance = min(1.0, len(after) * float(p[clearest]))
    return float(np.sqrt(squared_step[clearest])), int(after[clearest]), chance

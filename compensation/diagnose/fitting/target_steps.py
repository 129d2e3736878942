"""A test for steps in the residuals of each target in each placement.

A seat may move, an artefact may be knocked or a joint may slip half-way through the readings of one
target. It shows as a step between the first of them and the others, whatever their times.
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
    """The residuals of the rests at one target in one placement, in the order of the readings."""

    placement: str
    target: str
    rests: int
    rms_um: float  # 3-D
    step_um: float  # clearest step from the mean of the first rests to that of the others
    after: int  # how many rests are before the step; 0: too few rests for a step
    step_p: float  # chance that the scatter about the two means makes a step as clear anywhere


def measure_target_steps(last: Fit) -> list[TargetStep]:
    """Measure the clearest step of each target in each placement."""
    observations = last.linear.rests.points
    residual_um, normal = 1e3 * last.point_residual_mm, last.linear.normal
    pairs = np.stack([observations.placement, observations.target], axis=1)
    entries = []
    named, group = np.unique(pairs, axis=0, return_inverse=True)
    rests = np.argsort(group.ravel(), kind="stable")
    ends = np.cumsum(np.bincount(group.ravel(), minlength=len(named)))
    for (placement, target), numbers in zip(named, np.split(rests, ends[:-1]), strict=True):
        deviations = residual_um[numbers]
        if normal is not None and normal[numbers[0]].any():  # a surface counts along its normal
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
    """Select the entries with a step that their own scatter does not explain.

    A step of a single target may be the arm's or the base's, which the search looks for.
    """
    return [entry for entry in entries if len(entries) > 1 and len(entries) * entry.step_p < STEP_P]


def _clearest_step(deviations: F64) -> tuple[float, int, float]:
    """Find the clearest step in residuals (n, c) in c directions, 3 or 1.

    All divisions into first rests and others are tried. Returns the step's size, after how many
    rests it is, and its p value. The p value compares the step with the scatter about the two means
    (Hotelling's test with equal variances). Residuals at other targets do not describe this one,
    and a step half-way through inflates the RMS of all its own residuals.
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

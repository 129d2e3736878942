"""What is left, placement by placement and target by target: does one stand apart in itself?

A seat that moved, an artefact knocked or a joint that slipped half-way through the readings of one
target shows as a step between the first of them and the others, whatever the clock says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.compensation.diagnose.fit import Fit

F64 = npt.NDArray[np.float64]

#: Rests whose mean says where a target stood.
LEAST_PART = 3
#: A step stands out if it is so many times what is left at the other targets (3-D RMS).
STANDS_OUT = 4.0


@dataclass(frozen=True)
class Leftover:
    """What is left of the rests at one target in one placement, in the order of the readings."""

    placement: str
    target: str
    rests: int
    rms_um: float  # 3-D
    step_um: float  # between the mean of the first rests and that of the others, the largest
    after: int  # how many the first are; 0: too few rests for a step


def leftovers(last: Fit) -> list[Leftover]:
    """One entry per placement and target."""
    observations = last.linear.rests.observations
    left = 1e3 * (last.raw_residual - last.fitted)[: 3 * observations.n].reshape(-1, 3)
    pairs = np.stack([observations.placement, observations.target], axis=1)
    found = []
    for placement, target in np.unique(pairs, axis=0):
        own = left[(pairs == (placement, target)).all(axis=1)]
        step_um, after = _largest_step(own)
        found.append(
            Leftover(
                observations.placement_names[placement],
                observations.target_names[target],
                len(own),
                float(np.sqrt((own**2).sum(axis=1).mean())),
                step_um,
                after,
            )
        )
    return found


def steps(of: list[Leftover]) -> list[Leftover]:
    """Those with a step that stands out from what is left elsewhere."""
    found = []
    for one in of:
        others = [other for other in of if other is not one]
        rests = sum(other.rests for other in others)
        if not rests:
            continue
        level = np.sqrt(sum(other.rests * other.rms_um**2 for other in others) / rests)
        if one.step_um > STANDS_OUT * level:
            found.append(one)
    return found


def _largest_step(own: F64) -> tuple[float, int]:
    """Of (n, 3) what is left, over all ways to part the first from the others."""
    n = len(own)
    if n < 2 * LEAST_PART:
        return 0.0, 0
    after = np.arange(LEAST_PART, n - LEAST_PART + 1)
    sums = np.cumsum(own, axis=0)
    first = sums[after - 1] / after[:, None]
    rest = (sums[-1] - sums[after - 1]) / (n - after)[:, None]
    size = np.linalg.norm(rest - first, axis=1)
    largest = int(np.argmax(size))
    return float(size[largest]), int(after[largest])

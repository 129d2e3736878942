"""Single rests that belong to no effect, judged against tails as heavy as the noise has."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armd.compensation.diagnose.fitting.fit import Fit
from armd.compensation.estimate.robust import outlying

I64 = npt.NDArray[np.int64]


def find_outliers(current: Fit) -> tuple[I64, float]:
    """Rests whose residual no tail explains, and the smallest family-wise p."""
    n = current.linear.rests.n
    left = (current.raw_residual - current.fitted)[: 3 * n].reshape(n, 3)
    white = np.einsum("nij,nj->ni", current.noise.whitener, left)
    return outlying((white**2).sum(axis=1))

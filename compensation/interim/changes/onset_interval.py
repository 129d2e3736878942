"""The interval of onsets that is reported with a change."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64

#: The share of the onsets' probability that the interval contains.
COVERAGE = 0.95


def find_onset_interval(share: F64) -> tuple[int, int]:
    """Return the first and last onset of the shortest run that contains `COVERAGE` of
    the probability.
    """
    total = np.concatenate([[0.0], np.cumsum(share)])
    runs = [
        (b - a, -(total[b + 1] - total[a]), a, b)
        for a in range(len(share))
        for b in range(a, len(share))
        if total[b + 1] - total[a] >= COVERAGE * total[-1]
    ]
    _, _, a, b = min(runs)
    return a, b

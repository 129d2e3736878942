"""The gain of a model in a session that nobody has measured yet.

Held-out readings are of the same sessions as those that made the model. So the interval of a gain
over them is too narrow for another session: that has other postures and temperatures, and shows
more or less of what was corrected. The measured sessions show how much sessions differ.
"""

from __future__ import annotations

import numpy as np
from scipy.special import stdtrit

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import INTERVAL_TAIL, LEAST_SCATTERED
from armd.compensation.estimate.observations import Observations


def predict_later_gain(
    before: F64, after: F64, readings: Observations
) -> tuple[float, float] | None:
    """Return the 95 % interval of the gain in 3-D RMS, µm, in one more session.

    The session is like those of *readings*; None is returned for one placement only. *before*,
    *after*: squared held-out residuals (n,) mm². It is the prediction interval for one more draw,
    of normal gains of unknown scatter: mean ± t s √(1/m + 1/k) for k gains, m of which are a
    session (Hahn and Meeker, Statistical Intervals, 1991).
    """
    sessions = _gain_by(before, after, readings.session)
    placements = _gain_by(before, after, readings.placement)
    gains, in_one = placements, max(1.0, len(placements) / len(sessions))
    if len(sessions) >= LEAST_SCATTERED:
        gains, in_one = sessions, 1.0
    k = len(gains)
    if k < 2:
        return None
    of_all = float(_gain_by(before, after, np.zeros(len(before), dtype=np.int64))[0])
    error = float(gains.std(ddof=1)) * float(np.sqrt(1.0 / in_one + 1.0 / k))
    reach = -float(stdtrit(k - 1, INTERVAL_TAIL)) * error
    return of_all - reach, of_all + reach


def _gain_by(before: F64, after: F64, labels: I64) -> F64:
    """Return the fall (k,) of the 3-D RMS, µm, of the readings of each label (n,)."""
    index = np.unique(labels, return_inverse=True)[1]
    count = np.bincount(index)
    old, new = (np.sqrt(np.bincount(index, squares) / count) for squares in (before, after))
    gained: F64 = 1e3 * (old - new)
    return gained

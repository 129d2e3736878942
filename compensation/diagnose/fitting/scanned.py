"""How uncertain a value is that was scanned rather than fitted: a time constant."""

from __future__ import annotations

from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.signatures import finding_columns
from armd.compensation.model.arm import Arm

#: The signature's slope is taken between values this share apart to either side.
STEP = 0.02
#: An uncertainty so many times the value says that the readings do not tell it; JSON has no more.
UNTOLD = 1e3


def scanned_uncertainty(last: Fit, index: int, arm: Arm) -> float:
    """Standard uncertainty of a finding's scanned value, its amplitudes and all else fitted along.

    0 where it has none to be stated; `UNTOLD` times the value where the readings do not tell it.
    """
    candidate = last.findings[index]
    if candidate.elsewhere is None or not candidate.setting:
        return 0.0
    value = candidate.setting[0][1]
    beside = [candidate.elsewhere(value * (1.0 + sign * STEP)) for sign in (1.0, -1.0)]
    more, less = (
        block @ last.amplitudes[index] for block in finding_columns(last.linear, beside, arm)
    )
    slope = (more - less) / (2.0 * STEP * value)
    white, taken = last.noise.whiten(slope), last.problem.project(last.across(slope))
    clear = float(white @ white - taken @ taken)
    return float(min(max(clear, 1e-300) ** -0.5, UNTOLD * value))

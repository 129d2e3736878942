"""How uncertain a value is that was scanned rather than fitted: a time constant."""

from __future__ import annotations

from armd.compensation.diagnose.constants import LEAST_POSITIVE, SLOPE_STEP, UNTOLD
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.model.arm import Arm


def compute_scanned_uncertainty(last: Fit, index: int, arm: Arm) -> float:
    """Standard uncertainty of a finding's scanned value, its amplitudes and all else fitted along.

    0 where it has none to be stated; `UNTOLD` times the value where the readings do not tell it.
    """
    candidate = last.findings[index]
    if candidate.elsewhere is None or not candidate.setting:
        return 0.0
    value = candidate.setting[0][1]
    shifted = [candidate.elsewhere(value * (1.0 + sign * SLOPE_STEP)) for sign in (1.0, -1.0)]
    raised, lowered = (
        block @ last.amplitudes[index] for block in make_finding_columns(last.linear, shifted, arm)
    )
    slope = (raised - lowered) / (2.0 * SLOPE_STEP * value)
    white, absorbed = last.noise.whiten(slope), last.problem.project(last.across(slope))
    cleared = float(white @ white - absorbed @ absorbed)
    return float(min(max(cleared, LEAST_POSITIVE) ** -0.5, UNTOLD * value))

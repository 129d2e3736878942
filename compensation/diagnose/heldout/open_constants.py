"""The constants that findings which are not written leave open, because they absorbed a part of
them.

Such a calibration has constants that are wrong by what they could absorb of an effect, many times
their own uncertainty. It predicts well all the same: where it was measured, constants and effect
compensate each other. In live use this does no harm. But a diagnosis under such a calibration must
not keep these constants fixed: then the rest of the effect has the shape of another cause.

So the extended calibration states how far each finding that is not written would move what was
identified. A diagnosis under it takes that as one more way in which its constants may be wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armd.arrays import F64
from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.constants import MOVE_DIGITS
from armd.compensation.diagnose.extend import extend_calibration
from armd.compensation.diagnose.fitting.refit import Refits
from armd.compensation.diagnose.problem.baseline import LEFT_OPEN, collect_identified
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration


def add_open_constants(
    written: Calibration, last: Fit, numbers: Sequence[int], arm: Arm, sessions: Sequence[Session]
) -> Calibration:
    """Add to the *written* calibration how far the unwritten findings would move its constants.

    *numbers*: the findings that are written.
    """
    unwritten = [i for i in range(len(last.findings)) if i not in numbers]
    if not unwritten:
        return written
    refits = Refits(last)
    names = [
        name for name in written.covariance_of if name in last.baseline.calibration.covariance_of
    ]
    now = collect_identified(written, names)
    openings: list[dict[str, Any]] = []
    if not numbers:  # nothing was written: what was open before stays open
        openings += written.provenance["diagnosis"].get("earlier", {}).get(LEFT_OPEN, [])
    for i in unwritten:
        with_it = extend_calibration(refits.with_subset([*numbers, i]), arm, sessions)
        moves: F64 = collect_identified(with_it, names) - now
        finding = last.findings[i]
        openings.append(
            {
                "finding": f"{finding.cause} {finding.location}",
                "moves": dict(zip(names, np.round(moves, MOVE_DIGITS).tolist(), strict=True)),
            }
        )
    diagnosis = {**written.provenance["diagnosis"], LEFT_OPEN: openings}
    return written.model_copy(update={"provenance": {**written.provenance, "diagnosis": diagnosis}})

"""What somebody can tell who knows cause, place and shape; for corrections the instant, too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from drawn_changes import Case

from armd.compensation.interim.changes.change import Change
from armd.compensation.interim.changes.growth import find_origin_d, fit_growth
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence import likelihood
from armd.compensation.interim.evidence.stack import RunningSums, Stack


def oracle_delay(
    of: Stack, causes: Sequence[Cause], right: int, grows: bool, first: int, bad: list[int]
) -> float:
    """The same statistic with the whole prior on the truth, bad checks left out by hand."""
    knowing = [
        replace(c, prior_sudden=float(k == right and not grows),
                prior_gradual=float(k == right and grows))
        for k, c in enumerate(causes)
    ]  # fmt: skip
    kept = [i for i in range(of.n) if i not in bad]
    sums = RunningSums(of.select_checks(kept))
    for count in range(1, len(kept) + 1):
        if kept[count - 1] < first:
            continue
        weighed = likelihood.weigh(sums, knowing, count, np.arange(count))
        if weighed.log_sum >= likelihood.LIMIT:
            return kept[count - 1] - first + 1
    return float(np.inf)


def true_change(case: Case, of: Stack, right: int, first: int) -> Change:
    """The change as it was, from the first good check on that has it."""
    kept = [i for i in range(of.n) if i not in case.bad_checks]
    nearest = next(i for i in kept if i >= first)
    truth = Change(right, case.grows, nearest, nearest, nearest, np.nan, 1.0)
    if not case.grows:
        return truth
    origin = find_origin_d(of, kept, kept.index(nearest))
    return fit_growth(of, replace(truth, origin_d=origin), kept, [nearest])

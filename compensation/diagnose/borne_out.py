"""Which findings the extended calibration gets: those that readings held out bear out.

A finding is significant on the readings it was made of; whether the model is better with it, only
others can tell. Findings join one after another, in the order in which they were found, where the
held-out error falls beyond doubt; one that helps only beside a later one gets its turn again.

What this costs and saves: a finding that is worth nothing passes once in forty (the interval has
2.5 % below zero), and then by what chance made of it; a true one of five noise units passes mostly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from armd.compensation.arm import Arm
from armd.compensation.diagnose.baseline import Baseline
from armd.compensation.diagnose.extend import extended
from armd.compensation.diagnose.fit import Fit, Refits
from armd.compensation.diagnose.gain import Gain, folds_of, gain, groups_of, left_out
from armd.compensation.diagnose.neighbourhood import scale_kept
from armd.compensation.diagnose.search import Result
from armd.compensation.diagnose.shape import is_shape, shape_place
from armd.compensation.identify.evaluate import evaluate
from armd.compensation.session import Session

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

#: Where placements are left out, the finding was chosen with them too. That hardly flatters one so
#: sure that a search without any of them finds it as well; a weaker one must be found again.
SURE_P = 1e-6


@dataclass(frozen=True)
class BorneOut:
    """The findings written, by number, and squared residuals held out (n,) mm² with them."""

    some: tuple[int, ...]
    squares: F64


Squares = Callable[[Sequence[int]], F64]  # findings by number → squared residuals (n,) mm²


def choose(result: Result, squares: Squares, groups: I64, able: Sequence[bool]) -> BorneOut:
    """Those of the findings *able* to be written that held-out readings bear out."""
    chosen: tuple[int, ...] = ()
    error = squares(chosen)
    left = [i for i, ok in enumerate(able) if ok]
    more = True
    while more and left:
        more = False
        for i in list(left):
            if not _has_its_cause(result.last, i, chosen):
                continue
            some = tuple(sorted((*chosen, i)))
            tried = squares(some)
            if gain(error, tried, groups).shown:
                chosen, error, more = some, tried, True
                left.remove(i)
    every = tuple(i for i, ok in enumerate(able) if ok)
    if left and len(left) > 1 and gain(error, tried := squares(every), groups).shown:
        return BorneOut(every, tried)  # some help only together
    return BorneOut(chosen, error)


def by_placement(result: Result, arm: Arm, stepwise: Sequence[Gain]) -> BorneOut:
    """By whole placements left out in turn; *stepwise*: gains of a search repeated without them."""
    last = result.last
    folds = folds_of(last)
    refits = {}
    for part in map(int, np.unique(folds)):
        out = folds == part
        whitener = np.where(out[:, None, None], 0.0, last.noise.whitener)
        refits[part] = (out, Refits(last, replace(last.noise, whitener=whitener)))

    def squares(some: Sequence[int]) -> F64:
        found = np.zeros(len(folds))
        for out, refit in refits.values():
            fit = refit.with_some(some)
            as_given = last.baseline.held and not some
            found[out] = left_out(fit, out, as_given) * scale_kept(fit, arm) ** 2
        return found

    able = [
        found.p_value < SURE_P or own.shown
        for found, own in zip(result.found, stepwise, strict=True)
    ]
    return choose(result, squares, groups_of(last.linear.rests.observations), able)


def by_session(
    result: Result,
    baseline: Baseline,
    arm: Arm,
    sessions: Sequence[Session],
    holdout: Sequence[Session],
) -> BorneOut:
    """By sessions that had no part in anything."""
    last = result.last
    refit = Refits(last, last.noise)
    observations = evaluate(holdout, arm, baseline.calibration).observations

    def squares(some: Sequence[int]) -> F64:
        fit = refit.with_some(some)
        model = extended(baseline, fit, arm, sessions) if some else baseline.calibration
        residual = evaluate(holdout, arm, model).residual_mm
        square: F64 = (residual**2).sum(axis=1) * scale_kept(fit, arm) ** 2
        return square

    return choose(result, squares, groups_of(observations), [True] * len(result.found))


def _has_its_cause(last: Fit, index: int, chosen: Sequence[int]) -> bool:
    """A shape is written with the finding whose shape it is, or not at all."""
    finding = last.findings[index]
    if not is_shape(finding):
        return True
    return any(shape_place(last.findings[i]) == finding.location for i in chosen)

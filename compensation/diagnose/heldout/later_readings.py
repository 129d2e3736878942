"""A test whether a drift is known forward in time: later readings, predicted from earlier ones.

Placements held out in turn lie between others: a wave or a curve through these also fits the ones
held out. A calibration is used after its last reading.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import KNOWN_PARTS, TIME_PARTS
from armd.compensation.diagnose.fitting.refit import make_refits_without
from armd.compensation.diagnose.heldout.gain import compute_heldout_squares
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.diagnose.problem.whitening import Nuisance
from armd.compensation.effects.courses import is_drift
from armd.compensation.estimate.folds import assign_time_folds
from armd.compensation.estimate.observations import Observations
from armd.compensation.model.arm import Arm


def make_later_squares(last: Fit, arm: Arm) -> Callable[[Sequence[int], bool], F64]:
    """Make a function that returns squared residuals mm² of later rests by models of the earlier
    ones.

    Its arguments are the findings in the model and whether the first link expands. As in an
    extended calibration, a drift keeps the value that it had at the last reading.
    """
    part = split_in_time(last.linear.rests.observations)
    time_s = last.linear.rests.observations.states.time_s
    refits = []
    for n_parts in KNOWN_PARTS:
        out = part >= n_parts
        if not 0 < out.sum() < len(out):
            continue
        frozen = _freeze_drifts(last, float(time_s[~out].max()), arm)
        refits += [(out, refit) for refit in make_refits_without(frozen, [out])]

    def squares(numbers: Sequence[int], growth: bool) -> F64:
        squared = [np.zeros(0)]
        for out, refit in refits:
            squared.append(compute_heldout_squares(refit.with_subset(numbers), out, arm, growth))
        return np.concatenate(squared)

    return squares


def split_in_time(observations: Observations) -> I64:
    """Return the part of the time (n,) to which each rest belongs.

    A part has whole placements one after the other, or is a block of time if placements are fewer
    than parts.
    """
    placement = observations.placement
    numbers = np.unique(placement)
    if len(numbers) < TIME_PARTS:
        return assign_time_folds(observations.states.time_s, TIME_PARTS)
    begin = np.array([observations.states.time_s[placement == p].min() for p in numbers])
    turn = np.empty(len(numbers), dtype=np.int64)
    turn[np.argsort(begin, kind="stable")] = np.arange(len(numbers))
    parts: I64 = (turn * TIME_PARTS // len(numbers))[np.searchsorted(numbers, placement)]
    return parts


def _freeze_drifts(last: Fit, until_s: float, arm: Arm) -> Fit:
    """Return the fit with every drift's columns constant after *until_s*, as if identified until
    then.
    """
    linear = last.linear
    observations = linear.rests.observations
    states = observations.states
    stopped = replace(states, time_s=np.minimum(states.time_s, until_s))
    rests = replace(linear.rests, observations=replace(observations, states=stopped))
    columns = last.nuisance.columns
    for candidate, span in zip(last.findings, last.layout.findings, strict=True):
        if is_drift(candidate):
            stood = make_finding_columns(replace(linear, rests=rests), [candidate], arm)
            columns = columns.replace_columns(span, stood)
    return replace(last, nuisance=Nuisance(columns, last.nuisance.variance))

"""Whether one set of causes predicts readings held out better than another, about one point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.fitting.refit import refits_without, solve_again
from armd.compensation.diagnose.heldout.gain import capped, groups_of, left_out
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.rests import folds_of
from armd.compensation.effects.effect import Candidate
from armd.compensation.model.arm import Arm


def better_by(
    about: Fit, before: Sequence[Candidate], after: Sequence[Candidate], arm: Arm
) -> float:
    """By how many standard errors readings of placements left out in turn are predicted better
    with the findings *after* than with those *before*, all amplitudes estimated without them."""
    old, new = (_squares(about, findings, arm) for findings in (before, after))
    groups = groups_of(about.linear.rests.observations)
    return in_standard_errors(*capped(old, new), groups)


def in_standard_errors(before: F64, after: F64, groups: I64) -> float:
    """The fall from squared residuals *before* to *after* (n,), in standard errors of its sum over
    *groups* (n,), each a draw; zero where nothing changes."""
    by_group = np.bincount(np.unique(groups, return_inverse=True)[1], before - after)
    n = len(by_group)
    error = float(np.sqrt(n * by_group.var(ddof=1))) if n > 1 else 0.0
    return float(by_group.sum()) / error if error > 0.0 else 0.0


def _squares(about: Fit, findings: Sequence[Candidate], arm: Arm) -> F64:
    """Squared residuals (n,) mm² of rests, the amplitudes of placements other than theirs."""
    folds = folds_of(about.linear.rests)
    known = solve_again(about, findings, about.noise, arm)
    squares = np.zeros(len(folds))
    outs = [folds == part for part in np.unique(folds)]
    for out, refits in zip(outs, refits_without(known, outs), strict=True):
        squares[out] = left_out(refits.with_some(range(len(findings))), out, arm)
    return squares

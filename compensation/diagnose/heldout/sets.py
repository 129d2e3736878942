"""What is predicted of readings left out in turn, and whether by one set of causes better than by
another, about one point."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.fitting.refit import make_refits_without, solve_again
from armd.compensation.diagnose.heldout.gain import (
    compute_left_out_squares,
    group_readings,
    limit_squares,
)
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.rests import assign_folds
from armd.compensation.effects.effect import Candidate
from armd.compensation.model.arm import Arm


def make_squares_in_turn(last: Fit, arm: Arm, folds: I64) -> Callable[[Sequence[int], bool], F64]:
    """Squared residuals mm² of the points in each of the *folds* (n,), under a model of the others,
    by the findings in it and whether the first link grows."""
    outs = [folds == part for part in np.unique(folds)]
    refits = make_refits_without(last, outs)
    points = last.linear.rests.points.n  # which stand first

    def squares(numbers: Sequence[int], growth: bool) -> F64:
        squared = np.zeros(points)
        for out, refit in zip(outs, refits, strict=True):
            squared[out[:points]] = compute_left_out_squares(
                refit.with_subset(numbers), out, arm, growth
            )
        return squared

    return squares


def compare_heldout(
    about: Fit, before: Sequence[Candidate], after: Sequence[Candidate], arm: Arm
) -> float:
    """By how many standard errors readings of placements left out in turn are predicted better
    with the findings *after* than with those *before*, all amplitudes estimated without them."""
    old, new = (_compute_squares(about, findings, arm) for findings in (before, after))
    groups = group_readings(about.linear.rests.points)
    return count_standard_errors(*limit_squares(old, new), groups)


def count_standard_errors(before: F64, after: F64, groups: I64) -> float:
    """The fall from squared residuals *before* to *after* (n,), in standard errors of its sum over
    *groups* (n,), each a draw; zero where nothing changes."""
    by_group = np.bincount(np.unique(groups, return_inverse=True)[1], before - after)
    n = len(by_group)
    error = float(np.sqrt(n * by_group.var(ddof=1))) if n > 1 else 0.0
    return float(by_group.sum()) / error if error > 0.0 else 0.0


def _compute_squares(about: Fit, findings: Sequence[Candidate], arm: Arm) -> F64:
    """Squared residuals (n,) mm² of rests, the amplitudes of placements other than theirs."""
    solved = solve_again(about, findings, arm)
    squares = make_squares_in_turn(solved, arm, assign_folds(about.linear.rests))
    return squares(range(len(findings)), False)

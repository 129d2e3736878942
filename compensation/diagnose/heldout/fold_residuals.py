"""A comparison of two sets of causes, about one point, on readings held out in turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.fitting.refit import make_refits_without, solve_with_findings
from armd.compensation.diagnose.heldout.gain import (
    compute_heldout_squares,
    group_readings,
    limit_squares,
)
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.rests import assign_folds
from armd.compensation.effects.effect import Candidate
from armd.compensation.model.arm import Arm


def make_squares_in_turn(last: Fit, arm: Arm, folds: I64) -> Callable[[Sequence[int], bool], F64]:
    """Make a function that returns squared residuals mm² of the points in each of the *folds* (n,).

    They are under a model of the other folds. The arguments are the findings in it and whether the
    first link expands.
    """
    outs = [folds == part for part in np.unique(folds)]
    refits = make_refits_without(last, outs)
    points = last.linear.rests.points.n  # points come before orientations

    def squares(numbers: Sequence[int], growth: bool) -> F64:
        squared = np.zeros(points)
        for out, refit in zip(outs, refits, strict=True):
            squared[out[:points]] = compute_heldout_squares(
                refit.with_subset(numbers), out, arm, growth
            )
        return squared

    return squares


def compare_heldout(
    about: Fit, before: Sequence[Candidate], after: Sequence[Candidate], arm: Arm
) -> float:
    """Return by how many standard errors *after* predicts held-out readings better than *before*.

    Placements are held out in turn; all amplitudes are estimated without them.
    """
    old, new = (_compute_squares(about, findings, arm) for findings in (before, after))
    groups = group_readings(about.linear.rests.points)
    return count_standard_errors(*limit_squares(old, new), groups)


def count_standard_errors(before: F64, after: F64, groups: I64) -> float:
    """Return the fall from squared residuals *before* to *after* (n,), in standard errors of its
    sum.

    The sum is over *groups* (n,), each a draw; the result is zero where nothing changes.
    """
    by_group = np.bincount(np.unique(groups, return_inverse=True)[1], before - after)
    n = len(by_group)
    error = float(np.sqrt(n * by_group.var(ddof=1))) if n > 1 else 0.0
    return float(by_group.sum()) / error if error > 0.0 else 0.0


def _compute_squares(about: Fit, findings: Sequence[Candidate], arm: Arm) -> F64:
    """Return squared residuals (n,) mm² of points, with amplitudes from the other placements."""
    solved = solve_with_findings(about, findings, arm)
    squares = make_squares_in_turn(solved, arm, assign_folds(about.linear.rests))
    return squares(range(len(findings)), False)

"""Gauss–Newton steps from the linear solution, where the model is not linear.

The search is linear about one point. Directions that earlier readings hardly determined (the last
joint's twist against the tip's offset) may be very uncertain. A step along them moves the tip by
next to nothing to first order, but by microns to second order.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armd.compensation.diagnose.constants import MOST_FOLLOW_ROUNDS, STAYS
from armd.compensation.diagnose.fitting.fit import compute_kinematic_part, make_normal_equations
from armd.compensation.diagnose.fitting.nuisance import collect_nuisance
from armd.compensation.diagnose.fitting.refit import solve_with_columns
from armd.compensation.diagnose.problem.baseline import add_findings, apply_step
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.diagnose.problem.whitening import Nuisance
from armd.compensation.estimate.linear.bordered import compute_pseudo_inverse_factor
from armd.compensation.model.arm import Arm


def follow_solution(last: Fit, arm: Arm) -> Fit:
    """Solve a fit under a given calibration again about its solution, until it stays there.

    If that takes too many rounds, the last point is returned. Each step is taken only as far as it
    lowers the cost that the fit minimises, so that this point is better than the calibration's
    constants. Without a given calibration the fit itself is returned: its constants were moved
    already.
    """
    if not last.baseline.is_given or not last.findings:
        return last
    start = last.solution.copy()
    start[last.layout.identified] = 0.0
    point = replace(last, solution=start)
    refitted, share = _about_its_solution(point, arm), 1.0
    for _ in range(MOST_FOLLOW_ROUNDS):
        if _change(point, refitted) < STAYS:
            return refitted
        tried = _part_of_the_way(point, refitted, share)
        tried_refitted = _about_its_solution(tried, arm)
        if _cost(tried, tried_refitted) < _cost(point, refitted):
            point, refitted, share = tried, tried_refitted, min(2.0 * share, 1.0)
        else:
            share /= 2.0
    return replace(refitted, solution=point.solution, amplitudes=point.amplitudes)


def _cost(point: Fit, refitted: Fit) -> float:
    """Return the cost that the fit minimises, at the *point* about which it was linearised.

    It is the sum of squares of residuals and priors. Nuisance unknowns are at their best there; the
    arm's unknowns and the amplitudes are at the point.
    """
    white = refitted.noise.whiten(refitted.residual - refitted.fitted)
    prior = refitted.solution**2 / refitted.nuisance.variance
    return float(white @ white + prior.sum()) + _change(point, refitted) ** 2


def _part_of_the_way(before: Fit, after: Fit, share: float) -> Fit:
    """Return *after* with its solution moved to this share of the way from *before*."""
    amplitude_pairs = zip(before.amplitudes, after.amplitudes, strict=True)
    return replace(
        after,
        solution=before.solution + share * (after.solution - before.solution),
        amplitudes=tuple(a + share * (b - a) for a, b in amplitude_pairs),
    )


def _change(before: Fit, after: Fit) -> float:
    """Return the distance between two solutions, in standard uncertainties.

    It is taken over the arm's unknowns and the findings' amplitudes together.
    """
    layout = after.layout
    span = slice(layout.identified.start, layout.mount.start)
    change = after.solution[span] - before.solution[span]
    factor = compute_pseudo_inverse_factor(after.problem.covariance_of(span))
    return float(np.linalg.norm(factor.T @ change))


def _about_its_solution(last: Fit, arm: Arm) -> Fit:
    """Solve the same problem again, its columns taken at the solution.

    The constants' prior stays about the calibration, and the same residuals stay clipped.
    """
    baseline, identified = last.baseline, last.layout.identified
    step = -last.solution[identified]
    model = add_findings(
        apply_step(baseline.model, baseline, baseline.root @ step), last.findings, last.amplitudes
    )
    linear = linearise(last.linear.rests, model, arm)
    columns = make_finding_columns(linear, last.findings, arm)
    sizes = [1.0] * len(columns)  # not used: the variances stay
    nuisance, layout = collect_nuisance(linear, arm, baseline, last.findings, columns, sizes)
    nuisance = Nuisance(nuisance.columns, last.nuisance.variance)
    # The step's own part is removed, so that the solution is the whole step.
    raw = linear.residual - compute_kinematic_part(last.findings, columns, last.amplitudes)
    raw = raw - nuisance.columns.to_dense(identified) @ step
    clipped = raw - (last.raw_residual - last.residual)
    problem, side = make_normal_equations(nuisance.columns, nuisance, layout, last.noise, clipped)
    moved_to = replace(last, linear=linear, residual=clipped, raw_residual=raw)
    return solve_with_columns(moved_to, last.findings, nuisance.columns, layout, problem, side)

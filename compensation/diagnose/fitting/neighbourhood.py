"""Checks that a fit keeps the arm's size.

Where seats have no certified positions, an arm that shrinks, or a link that folds away, leaves less
scatter: the smaller error is no better model. A fit is refused if it moves a certified length by
more than its uncertainty allows.
"""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.diagnose.constants import CLEARLY_MORE, LEAST_SIZE_MM
from armd.compensation.diagnose.problem.baseline import add_findings, apply_step
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import ModelState
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.identify.evaluation.lengths import (
    MOST_OFF,
    Length,
    measure_certified_lengths,
)
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows


def compute_arm_size(fit: Fit, arm: Arm) -> float:
    """Return the arm's size under a fit, as a share of its size under the model under test."""
    constants = compute_parameter_rows(fit.baseline.model.constants, (), np.zeros((1, 0)))[0]
    lengths = constants * _is_length(arm)
    return float(_rows(fit, _solved(fit), arm).mean(axis=0) @ lengths / (lengths @ lengths))


def compute_scale_factor(fit: Fit, arm: Arm) -> float:
    """Return the factor that states a scatter as if the arm had kept its size.

    It is one where positions are certified, or truth is measured: there a smaller arm has a
    residual.
    """
    observations = fit.linear.rests.observations
    if observations.has_truth.any() or observations.says_size.any():
        return 1.0
    return 1.0 / max(compute_arm_size(fit, arm), LEAST_SIZE_MM)


def find_refusal(fit: Fit, before: Fit, arm: Arm) -> str:
    """Return the certified length that a fit loses because of a finding, in words; empty if none.

    *before*: a fit without the finding that is asked about.
    """
    if not len(fit.linear.rests.observations.distances.length_mm):
        return ""
    now, then = _lengths(fit, arm), _lengths(before, arm)
    lost = [
        a
        for a, b in zip(now, then, strict=True)
        if abs(a.off) > MOST_OFF
        and abs(a.error_mm) - abs(b.error_mm) > CLEARLY_MORE * a.uncertainty_mm
    ]
    if not lost:
        return ""
    worst = max(lost, key=lambda length: abs(length.off))
    between = ", ".join(worst.between)
    return (
        f"the certified length {between} would be off by {abs(worst.off):.0f} of its uncertainties"
    )


def _lengths(fit: Fit, arm: Arm) -> list[Length]:
    """Measure the certified lengths under a fit.

    A measured length lies between the means of readings that scatter. That scatter is part of its
    uncertainty, as the certificate's is.
    """
    linear = linearise(fit.linear.rests, _solved(fit), arm)
    n = linear.rests.n
    residual = linear.residual[: 3 * n].reshape(n, 3)
    return measure_certified_lengths(linear.rests.observations, linear.poses, residual)


def move_model(fit: Fit) -> ModelState:
    """Return the model at a fit's solution, findings not included."""
    step = -fit.solution[fit.layout.identified]
    directions = fit.baseline.root @ step if fit.baseline.is_given else step
    return apply_step(fit.model, fit.baseline, directions)


def _solved(fit: Fit) -> ModelState:
    """Return the model at a fit's solution, findings included."""
    return add_findings(move_model(fit), fit.findings, fit.amplitudes)


def _rows(fit: Fit, model: ModelState, arm: Arm) -> F64:
    """Return the parameters (n, P) of a model at each of a fit's rests."""
    states = fit.linear.rests.observations.states
    values = compute_basis_values(model.terms, states, arm, model.reference_c, model.constants)
    rows: F64 = compute_parameter_rows(model.constants, model.terms, np.nan_to_num(values))
    return rows


def _is_length(arm: Arm) -> Mask:
    lengths = arm.layout.are_lengths.copy()
    lengths[arm.layout.base] = False
    return lengths

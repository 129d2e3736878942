"""Checks that a fit stays near the model under test, and that an effect's size is possible.

Where seats have no certified positions, an arm that shrinks, or a link that folds away, leaves less
scatter: the smaller error is no better model. A fit is refused if it moves a parameter further than
an arm of its drawing can be off. It is also refused if it moves a certified length by more than its
uncertainty allows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.diagnose.constants import CLEARLY_MORE, LEAST_SIZE_MM, MOST_SIGMAS
from armd.compensation.diagnose.problem.amplitudes import compute_broadest_sd, is_sized
from armd.compensation.diagnose.problem.baseline import add_findings, apply_step
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import ModelState
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Candidate, Column
from armd.compensation.effects.largest import find_largest
from armd.compensation.estimate.gauge import PLAUSIBLE
from armd.compensation.identify.evaluation.lengths import (
    MOST_OFF,
    Length,
    measure_certified_lengths,
)
from armd.compensation.model import parameters
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.wording import format_plain


def find_refusal(fit: Fit, before: Fit, arm: Arm) -> str:
    """Return why a fit is not credible, in words; empty if it may be.

    *before*: a fit without the finding that is asked about.
    """
    for candidate, amplitudes in zip(fit.findings, fit.amplitudes, strict=True):
        if not is_possible(candidate, amplitudes):
            return "no such cause is that large"
    return _too_far(fit, arm) or _length_lost(fit, before, arm)


def is_possible(candidate: Candidate, amplitudes: F64) -> bool:
    """Return whether a named cause can be as large as that.

    An accident, and a cause without a name, may have any size.
    """
    named = candidate.cause != "unknown" and not CATALOGUE[candidate.cause].accident
    if not named or is_sized(candidate):
        return True
    largest_amplitudes = np.array([_largest_amplitude(column) for column in candidate.columns])
    return bool((np.abs(amplitudes) <= largest_amplitudes).all())


def _largest_amplitude(column: Column) -> float:
    """Return a named cause's largest amplitude; causes with the same effect have the same limit."""
    shared = find_largest(column)
    return shared if np.isfinite(shared) else MOST_SIGMAS * compute_broadest_sd(column)


def is_near(fit: Fit, arm: Arm) -> bool:
    """Return whether all parameters stay within a plausible departure of the model under test."""
    return not _too_far(fit, arm)


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


def _too_far(fit: Fit, arm: Arm) -> str:
    baseline, states = fit.baseline, fit.linear.rests.observations.states
    model = baseline.model
    values = compute_basis_values(model.terms, states, arm, model.reference_c, model.constants)
    were = compute_parameter_rows(model.constants, model.terms, values)
    rows = _rows(fit, _without_causes_turns(fit), arm)
    inner = slice(0, arm.layout.joint(arm.n_joints).start)  # base left out: it may stand anywhere
    names = (*arm.layout.names[inner], *(f"the tip's {axis}" for axis in "xyz"))
    departures = np.abs(
        np.hstack(
            [rows[:, inner] - were[:, inner], _tip_placed(rows, arm) - _tip_placed(were, arm)]
        )
    ).max(axis=0)
    units = [*map(parameters.find_unit, arm.layout.names[inner]), "mm", "mm", "mm"]
    furthest = int(np.argmax(departures / np.array([PLAUSIBLE[unit] for unit in units])))
    largest = float(departures[furthest])
    if largest <= PLAUSIBLE[units[furthest]]:
        return ""
    in_mm = units[furthest] == "mm"
    departure = f"{format_plain(largest)} mm" if in_mm else f"{format_plain(np.degrees(largest))}°"
    return f"it would move {names[furthest]} by {departure}"


def _tip_placed(rows: F64, arm: Arm) -> F64:
    """Return the tip (n, 3) mm in the frame before the last joint, at angle zero, by rows (n, P).

    The last joint's constants and the tip's offset determine only this point. No reading can
    separate them: a twist of degrees with the tip moved along is the same arm.
    """
    layout = ParameterLayout(1)
    last = np.zeros((len(rows), layout.count))
    last[:, layout.joint(1)] = rows[:, arm.layout.joint(arm.n_joints)]
    last[:, layout.tip] = rows[:, arm.layout.tip]
    return compute_pose(np.zeros((len(rows), 1)), last)[0]


def _length_lost(fit: Fit, before: Fit, arm: Arm) -> str:
    """Report a certified length that no longer agrees because of the finding; empty if none."""
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


def _without_causes_turns(fit: Fit) -> ModelState:
    """Return the model at a fit's solution without the angles that named causes add.

    No arm becomes smaller by these angles, and `is_possible` checks how large each may be.
    """
    model = move_model(fit)
    terms = [
        term
        for candidate, amplitudes in zip(fit.findings, fit.amplitudes, strict=True)
        for column, amplitude in zip(candidate.columns, amplitudes, strict=True)
        for term in column.make_terms(float(amplitude))
        if candidate.cause == "unknown" or parameters.find_unit(term.parameter) != "rad"
    ]
    return replace(model, terms=(*model.terms, *terms))


def _is_length(arm: Arm) -> Mask:
    lengths = arm.layout.are_lengths.copy()
    lengths[arm.layout.base] = False
    return lengths

"""A fit solved again about the same point with other findings: one linear step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.diagnose.constants import CURVE_SCALE
from armd.compensation.diagnose.fitting.fit import (
    find_determined_columns,
    fit_sizes,
    make_normal_equations,
)
from armd.compensation.diagnose.fitting.nuisance import replace_findings
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.layout import (
    DRIFT,
    PLACEMENTS,
    FitLayout,
    name_block,
    select_findings,
)
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.diagnose.problem.whitening import Nuisance
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.linear.blocks import Blocks
from armd.compensation.estimate.linear.linear_model import LinearModel
from armd.compensation.model.arm import Arm


def solve_with_findings(fit: Fit, findings: Sequence[Candidate], arm: Arm) -> Fit:
    """Solve the linear problem of a fit with other findings, in the same noise."""
    unsolved = set_findings(fit, findings, arm)
    return _sized_and_solved(unsolved, *_equations(unsolved))


def set_findings(fit: Fit, findings: Sequence[Candidate], arm: Arm) -> Fit:
    """Return a fit with other findings' columns, before any solution.

    Amplitudes are zero, and other solved values are not valid.
    """
    columns = make_finding_columns(fit.linear, findings, arm)
    sizes = [CURVE_SCALE] * len(findings)
    nuisance, layout = replace_findings(fit.nuisance, fit.layout, findings, columns, sizes)
    return replace(
        fit,
        findings=tuple(findings),
        amplitudes=tuple(np.zeros(len(candidate.columns)) for candidate in findings),
        nuisance=nuisance,
        layout=layout,
    )


class Refits:
    """The linear problem of one fit with subsets of its findings; its rows are summed only once."""

    def __init__(self, fit: Fit, equations: tuple[LinearModel, F64] | None = None) -> None:
        self._fit = fit
        self._problem, self._side = equations or _equations(fit)

    def with_subset(self, numbers: Sequence[int]) -> Fit:
        """Return the fit with the findings of these *numbers*."""
        fit = self._fit
        indices, layout = select_findings(fit.layout, numbers)
        findings = tuple(fit.findings[i] for i in numbers)
        problem, side = (
            replace(self._problem.only(indices), layout=layout.blocks),
            self._side[indices],
        )
        problem, _ = fit_sizes(problem, side, layout, findings, [CURVE_SCALE] * len(findings))
        columns = fit.nuisance.columns.only(indices)
        return solve_with_columns(fit, findings, columns, layout, problem, side)


def _equations(fit: Fit) -> tuple[LinearModel, F64]:
    """Return the linear problem of all of a fit's columns, and its right side."""
    return make_normal_equations(
        fit.nuisance.columns, fit.nuisance, fit.layout, fit.noise, fit.residual
    )


def make_refits_without(fit: Fit, left_out: Sequence[Mask]) -> list[Refits]:
    """Make the fit's linear problem without the rests *left_out* (n,), for each of these.

    No two of these sets overlap. An unknown of one placement alone has no effect on another
    placement. It is eliminated, and is no column of these problems and fits. They have the columns
    that placements share, a tenth of all columns where there are many placements.
    """
    free = np.zeros(fit.layout.blocks.n, dtype=bool)
    free[fit.layout.blocks.find_columns([PLACEMENTS, DRIFT])] = True
    eliminated = free & fit.nuisance.columns.in_one_piece
    shared = _of_shared(fit, eliminated)
    refits = []
    equations = _shared_equations(fit, shared, eliminated, left_out)
    for out, without in zip(left_out, equations, strict=True):
        whitener = np.where(out[:, None, None], 0.0, fit.noise.whitener)
        noise = replace(fit.noise, whitener=whitener)
        refits.append(Refits(replace(shared, noise=noise), without))
    return refits


def solve_shared_again(fit: Fit, findings: Sequence[Candidate], arm: Arm, eliminated: Mask) -> Fit:
    """Solve a fit again with other findings and only the columns that placements share.

    See `solve_with_findings` and `make_refits_without`. *eliminated*: which columns are eliminated,
    of those that there are without findings.
    """
    unsolved = set_findings(fit, findings, arm)
    first, stop = unsolved.layout.identified.stop, unsolved.layout.mount.start
    eliminated = np.concatenate(
        [eliminated[:first], np.zeros(stop - first, dtype=bool), eliminated[first:]]
    )
    shared = _of_shared(unsolved, eliminated)
    nothing = np.zeros(len(fit.noise.whitener), dtype=bool)
    ((problem, side),) = _shared_equations(unsolved, shared, eliminated, [nothing])
    return _sized_and_solved(shared, problem, side)


def _of_shared(fit: Fit, eliminated: Mask) -> Fit:
    """Return the fit with the columns that placements share; its solution is not valid."""
    shared = np.flatnonzero(~eliminated)
    return replace(
        fit,
        nuisance=Nuisance(fit.nuisance.columns.only(shared), fit.nuisance.variance[shared]),
        layout=FitLayout(fit.layout.blocks.only(shared), fit.layout.nominal_variance[shared]),
    )


def _shared_equations(
    fit: Fit, shared: Fit, eliminated: Mask, left_out: Sequence[Mask]
) -> list[tuple[LinearModel, F64]]:
    """Return linear problems and right sides of the columns *shared*, one for each of *left_out*.

    The fit's *eliminated* columns are fitted along. The rests left out are not used.
    """
    noise = fit.noise
    systems = fit.nuisance.columns.compute_products_clear_of(
        eliminated, fit.nuisance.variance, noise.whitener, noise.distance_mm, fit.residual, left_out
    )
    return [
        (
            LinearModel.from_products(
                shared.layout.blocks,
                products[:-1, :-1],
                shared.nuisance.variance,
                nominal_variance=shared.layout.nominal_variance,
                squared_norm=squared_norms,
            ),
            products[:-1, -1],
        )
        for products, squared_norms in systems
    ]


def _sized_and_solved(unsolved: Fit, problem: LinearModel, side: F64) -> Fit:
    """Solve a fit with all its columns and findings, with curves of their estimated size."""
    findings, layout = unsolved.findings, unsolved.layout
    problem, _ = fit_sizes(problem, side, layout, findings, [CURVE_SCALE] * len(findings))
    return solve_with_columns(unsolved, findings, unsolved.nuisance.columns, layout, problem, side)


def solve_with_columns(
    fit: Fit,
    findings: Sequence[Candidate],
    columns: Blocks,
    layout: FitLayout,
    problem: LinearModel,
    side: F64,
) -> Fit:
    """Solve a fit again about the same point with other nuisance columns (N, b)."""
    determined = find_determined_columns(problem)
    reduced, solution = problem.only(determined), np.zeros(len(side))
    solution[determined] = reduced.solve_amplitudes(side[determined])
    names = [name_block(i) for i in range(len(layout.findings))]
    return replace(
        fit,
        findings=tuple(findings),
        amplitudes=tuple(-solution[span] for span in layout.findings),
        covariances=tuple(reduced.covariance_of(reduced.layout[name]) for name in names),
        nuisance=Nuisance(columns, problem.variance),
        layout=layout,
        fitted=columns.times(solution),
        solution=solution,
        problem=problem,
    )

"""A fit about the same point, solved anew with other findings: one linear step, no rows moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.diagnose.constants import CURVE_SCALE
from armd.compensation.diagnose.fitting.fit import columns_told_of, normal_equations, sized
from armd.compensation.diagnose.fitting.nuisance import with_other_findings
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.layout import (
    DRIFT,
    PLACEMENTS,
    FitLayout,
    finding,
    with_some_findings,
)
from armd.compensation.diagnose.problem.signatures import finding_columns
from armd.compensation.diagnose.problem.whitening import Nuisance
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.linear.blocks import Blocks
from armd.compensation.estimate.linear.linear_model import LinearModel
from armd.compensation.model.arm import Arm


def solve_again(known: Fit, findings: Sequence[Candidate], arm: Arm) -> Fit:
    """The linear problem of a fit with other findings, in its noise; nothing else moves."""
    whole = with_findings_unsolved(known, findings, arm)
    return _sized_and_solved(whole, *_equations(whole))


def with_findings_unsolved(known: Fit, findings: Sequence[Candidate], arm: Arm) -> Fit:
    """The columns of a fit with other findings, to which no solution is known yet: amplitudes are
    zero, what else was solved is of no account."""
    columns = finding_columns(known.linear, findings, arm)
    sizes = [CURVE_SCALE] * len(findings)
    nuisance, layout = with_other_findings(known.nuisance, known.layout, findings, columns, sizes)
    return replace(
        known,
        findings=tuple(findings),
        amplitudes=tuple(np.zeros(len(candidate.columns)) for candidate in findings),
        nuisance=nuisance,
        layout=layout,
    )


class Refits:
    """One fit's linear problem with some of its findings only: the rows are summed once, or were,
    to *equations*."""

    def __init__(self, known: Fit, equations: tuple[LinearModel, F64] | None = None) -> None:
        self._known = known
        self._problem, self._side = equations or _equations(known)

    def with_some(self, some: Sequence[int]) -> Fit:
        """The fit with *some* of the findings, by number."""
        known = self._known
        kept, layout = with_some_findings(known.layout, some)
        findings = tuple(known.findings[i] for i in some)
        problem, side = replace(self._problem.only(kept), layout=layout.blocks), self._side[kept]
        problem, _ = sized(problem, side, layout, findings, [CURVE_SCALE] * len(findings))
        columns = known.nuisance.columns.only(kept)
        return solved(known, findings, columns, layout, problem, side)


def _equations(known: Fit) -> tuple[LinearModel, F64]:
    """The linear problem of all of a fit's columns, and its right side."""
    return normal_equations(
        known.nuisance.columns, known.nuisance, known.layout, known.noise, known.residual
    )


def refits_without(known: Fit, left_out: Sequence[Mask]) -> list[Refits]:
    """The fit's linear problem without the rests *left out* (n,), for each of these; no two of them
    overlap.

    What absorbs in one placement only says nothing of another one. It is fitted along, and is no
    column of these problems and fits: they have what placements share, a tenth of all columns where
    there are many placements, and explain for it alone.
    """
    free = np.zeros(known.layout.blocks.n, dtype=bool)
    free[known.layout.blocks.of([PLACEMENTS, DRIFT])] = True
    alone = free & known.nuisance.columns.in_one_piece
    shared = _of_shared(known, alone)
    refits = []
    equations = _shared_equations(known, shared, alone, left_out)
    for out, without in zip(left_out, equations, strict=True):
        whitener = np.where(out[:, None, None], 0.0, known.noise.whitener)
        noise = replace(known.noise, whitener=whitener)
        refits.append(Refits(replace(shared, noise=noise), without))
    return refits


def solve_shared_again(known: Fit, findings: Sequence[Candidate], arm: Arm, alone: Mask) -> Fit:
    """As `solve_again`, with columns for what placements share only, as `refits_without` has them.

    *alone*: which columns are fitted along, of those that there are without findings.
    """
    whole = with_findings_unsolved(known, findings, arm)
    first, stop = whole.layout.identified.stop, whole.layout.mount.start
    alone = np.concatenate([alone[:first], np.zeros(stop - first, dtype=bool), alone[first:]])
    shared = _of_shared(whole, alone)
    nothing = np.zeros(len(known.noise.whitener), dtype=bool)
    ((problem, side),) = _shared_equations(whole, shared, alone, [nothing])
    return _sized_and_solved(shared, problem, side)


def _of_shared(known: Fit, alone: Mask) -> Fit:
    """The fit with the columns of what placements share; its solution is of no account."""
    shared = np.flatnonzero(~alone)
    return replace(
        known,
        nuisance=Nuisance(known.nuisance.columns.only(shared), known.nuisance.variance[shared]),
        layout=FitLayout(known.layout.blocks.only(shared), known.layout.drawing[shared]),
    )


def _shared_equations(
    known: Fit, shared: Fit, alone: Mask, left_out: Sequence[Mask]
) -> list[tuple[LinearModel, F64]]:
    """Linear problem and right side of the columns *shared*, the known fit's others *alone* being
    fitted along, without the rests of each of *left_out*."""
    noise = known.noise
    found = known.nuisance.columns.products_clear_of(
        alone, known.nuisance.variance, noise.whitener, noise.distance_mm, known.residual, left_out
    )
    return [
        (
            LinearModel.of_products(
                shared.layout.blocks,
                products[:-1, :-1],
                shared.nuisance.variance,
                drawing=shared.layout.drawing,
                square=square,
            ),
            products[:-1, -1],
        )
        for products, square in found
    ]


def _sized_and_solved(whole: Fit, problem: LinearModel, side: F64) -> Fit:
    """A fit with all columns and findings, solved, the curves among these as large as they are."""
    findings, layout = whole.findings, whole.layout
    problem, _ = sized(problem, side, layout, findings, [CURVE_SCALE] * len(findings))
    return solved(whole, findings, whole.nuisance.columns, layout, problem, side)


def solved(
    known: Fit,
    findings: Sequence[Candidate],
    columns: Blocks,
    layout: FitLayout,
    problem: LinearModel,
    side: F64,
) -> Fit:
    """A fit about the same point, solved anew with other nuisance columns (N, b)."""
    told = columns_told_of(problem)
    some, solution = problem.only(told), np.zeros(len(side))
    solution[told] = some.amplitudes(side[told])
    names = [finding(i) for i in range(len(layout.findings))]
    return replace(
        known,
        findings=tuple(findings),
        amplitudes=tuple(-solution[at] for at in layout.findings),
        covariances=tuple(some.covariance_of(some.layout[name]) for name in names),
        nuisance=Nuisance(columns, problem.variance),
        layout=layout,
        fitted=columns.times(solution),
        solution=solution,
        problem=problem,
    )

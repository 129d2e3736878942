"""One model with the findings so far, fitted to the rests with their real noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from armd.compensation.diagnose.fitting import noise as noise_model
from armd.compensation.diagnose.fitting.baseline import Baseline, moved, scaled
from armd.compensation.diagnose.fitting.blocks import Blocks, in_blocks
from armd.compensation.diagnose.fitting.noise import Noise, Nuisance
from armd.compensation.diagnose.fitting.nuisance import (
    Layout,
    amplitude_variance,
    finding,
    for_noise,
    gather_nuisance,
    is_sized,
    with_other_findings,
    with_some_findings,
)
from armd.compensation.diagnose.fitting.problem import Linear, ModelState, Rests, linearise
from armd.compensation.diagnose.fitting.signatures import compile_candidates
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.linear_model import LinearModel
from armd.compensation.model.arm import Arm

F64 = npt.NDArray[np.float64]

#: A step errs by about its square over the arm's length; beyond this share of the noise the
#: model is linearised anew.
CURVED_SHARE = 0.1
LENGTH_MM = 200.0
MOST_STEPS = 6
#: A curve's likely size: this many times the catalogue's to begin with, then the data's own
#: (empirical Bayes).
CURVE_SCALE = 3.0
CURVE_SCALES = (0.3, 100.0)
SIZING_STEPS = 6
#: Gross errors are in the first estimate of the noise: it is made again with them clipped, until it
#: falls by less than a tenth. Noise without them settles at once.
MOST_CLIPPINGS = 10
SETTLED = 0.9


@dataclass(frozen=True)
class Fit:
    """Everything known after fitting: where the model stands, what is left, what absorbs."""

    baseline: Baseline
    linear: Linear
    model: ModelState  # constants and own terms, findings not included
    findings: tuple[Candidate, ...]
    amplitudes: tuple[F64, ...]  # per finding
    covariances: tuple[F64, ...]
    noise: Noise
    nuisance: Nuisance
    layout: Layout
    residual: F64  # (N,) before anything absorbs, winsorised about the fit
    raw_residual: F64  # (N,) the same as measured
    fitted: F64  # (N,) of it what the nuisance columns explain
    solution: F64  # (b,)
    inverse: F64  # (b, b) covariance of the solution
    problem: LinearModel  # of the nuisance columns

    def across(self, columns: F64) -> F64:
        """Products (b, …) of the nuisance columns with others (N, …), both whitened."""
        products: F64 = self._white.T @ self.noise.whiten(columns)
        return products

    @cached_property
    def _white(self) -> F64:
        return self.noise.whiten(self.nuisance.columns)

    def net_signature(self, index: int) -> F64:
        """Motion (n, 3) in mm of the tip by a finding, clear of all else in the model.

        What rests share by chance (certified targets, a slow drift) is noise: it weighs, but what
        it could take up is still the finding's.
        """
        moves = -self.nuisance.columns[:, self.layout.findings[index]] @ self.amplitudes[index]
        keep = self.layout.blocks.but([finding(index)])
        taken, _ = self.problem.only(keep).solve(self.across(moves)[keep])
        model = keep < self.layout.shared
        other = self.nuisance.columns[:, keep[model]] @ taken[model]
        net: F64 = (moves - other)[: 3 * self.linear.rests.n].reshape(-1, 3)
        return net


def with_findings(
    model: ModelState, findings: Sequence[Candidate], amplitudes: Sequence[F64]
) -> ModelState:
    """The model with the findings' terms appended."""
    terms = [
        term
        for candidate, values in zip(findings, amplitudes, strict=True)
        for column, value in zip(candidate.columns, values, strict=True)
        for term in scaled(column.terms, float(value))
    ]
    return replace(model, terms=(*model.terms, *terms))


def finding_columns(linear: Linear, findings: Sequence[Candidate], arm: Arm) -> list[F64]:
    """Columns (N, m) of each finding, in mm."""
    signatures = compile_candidates(findings, linear, arm)
    return [
        signatures.rows(linear, linear.jacobian, np.array(signatures.columns_of(i))).T
        for i in range(len(findings))
    ]


def fit(
    rests: Rests,
    arm: Arm,
    baseline: Baseline,
    model: ModelState,
    findings: Sequence[Candidate] = (),
    amplitudes: Sequence[F64] = (),
    noise_extra: Sequence[Candidate] = (),
    noise: Noise | None = None,
) -> Fit:
    """Gauss–Newton with the noise estimated along the way (from *noise*, where it is known).

    *noise_extra* absorbs while the noise is estimated, and only then: effects that look like
    noise (a steady drift) must not be counted as noise before they had their chance.
    """
    amplitudes = [values.copy() for values in amplitudes]
    sizes = [CURVE_SCALE] * len(findings)
    step_number, before_this = 0, np.inf
    while True:
        step_number += 1
        linear = linearise(rests, with_findings(model, findings, amplitudes), arm)
        columns = finding_columns(linear, findings, arm)
        # Without the findings' own part, so that the solution is the whole amplitude.
        residual = linear.residual - _kinematic_part(findings, columns, amplitudes)
        nuisance, layout = gather_nuisance(linear, arm, baseline, findings, columns, sizes)
        extra = finding_columns(linear, noise_extra, arm)
        noisy = for_noise(nuisance, layout, extra)
        blocks = in_blocks(noisy.columns, linear)
        if noise is None:
            noise = noise_model.estimate(linear, residual, blocks, noisy.variance)
        clipped, noise = _clipped(linear, residual, blocks, noisy.variance, nuisance, layout, noise)
        problem, side = _normal(blocks, nuisance.ridged(noise), layout, noise, clipped)
        problem, sizes = _sized(problem, side, layout, findings, sizes)
        nuisance = Nuisance(nuisance.columns, problem.variance)
        solution, inverse = problem.solve(side)
        fitted = nuisance.columns @ solution
        before = amplitudes
        amplitudes = [-solution[at] for at in layout.findings]
        shift = [
            block @ (new - old) for block, new, old in zip(columns, amplitudes, before, strict=True)
        ]
        if not baseline.held:
            step = -solution[layout.identified]
            shift.append(nuisance.columns[:, layout.identified] @ step)
        largest = max((float(np.abs(part).max()) for part in shift), default=0.0)
        near = largest**2 / LENGTH_MM < CURVED_SHARE * noise.scale_mm
        if near or step_number == MOST_STEPS or largest > before_this:
            break  # a step longer than the last one leads away: the linear answer stands
        before_this = largest
        if not baseline.held:
            model = moved(model, baseline, step)
    return Fit(
        baseline,
        linear,
        model,
        tuple(findings),
        tuple(amplitudes),
        tuple(inverse[at, at] for at in layout.findings),
        noise,
        nuisance,
        layout,
        clipped,
        residual,
        fitted,
        solution,
        inverse,
        problem,
    )


def _clipped(
    linear: Linear,
    residual: F64,
    blocks: Blocks,
    variance: F64,
    nuisance: Nuisance,
    layout: Layout,
    noise: Noise,
) -> tuple[F64, Noise]:
    """The residual (N,) winsorised about its fit, and the noise that is left then; *variance*: of
    the amplitudes while the noise is estimated."""

    def fitted_to(some: F64, own: Noise) -> F64:
        fitted: F64 = nuisance.columns @ _solve(blocks, nuisance, layout, own, some)
        return fitted

    clipped = noise_model.without_gross(residual, noise, fitted_to)
    for _ in range(MOST_CLIPPINGS):
        larger = noise.scale_mm
        noise = noise_model.estimate(linear, clipped, blocks, variance, noise)
        clipped = noise_model.winsorise(residual, fitted_to(clipped, noise), noise)
        if noise.scale_mm > SETTLED * larger:
            break
    return clipped, noise


def solve_again(known: Fit, findings: Sequence[Candidate], noise: Noise, arm: Arm) -> Fit:
    """The linear problem of a fit with other findings and another whitener; nothing else moves."""
    columns = finding_columns(known.linear, findings, arm)
    sizes = [CURVE_SCALE] * len(findings)
    nuisance, layout = with_other_findings(known.nuisance, known.layout, findings, columns, sizes)
    blocks = in_blocks(nuisance.columns, known.linear)
    problem, side = _normal(blocks, nuisance, layout, noise, known.residual)
    problem, _ = _sized(problem, side, layout, findings, sizes)
    return _solved(known, findings, nuisance.columns, layout, problem, side, noise)


class Refits:
    """One fit's linear problem with some of its findings only, for one whitener: the rows are
    summed once."""

    def __init__(self, known: Fit, noise: Noise) -> None:
        self._known, self._noise = known, noise
        blocks = in_blocks(known.nuisance.columns, known.linear)
        self._problem, self._side = _normal(
            blocks, known.nuisance, known.layout, noise, known.residual
        )

    def with_some(self, some: Sequence[int]) -> Fit:
        """The fit with *some* of the findings, by number."""
        known = self._known
        kept, layout = with_some_findings(known.layout, some)
        findings = tuple(known.findings[i] for i in some)
        problem, side = replace(self._problem.only(kept), layout=layout.blocks), self._side[kept]
        problem, _ = _sized(problem, side, layout, findings, [CURVE_SCALE] * len(findings))
        columns = known.nuisance.columns[:, kept]
        return _solved(known, findings, columns, layout, problem, side, self._noise)


def _solved(
    known: Fit,
    findings: Sequence[Candidate],
    columns: F64,
    layout: Layout,
    problem: LinearModel,
    side: F64,
    noise: Noise,
) -> Fit:
    """A fit about the same point, solved anew with other nuisance columns (N, b)."""
    solution, inverse = problem.solve(side)
    return replace(
        known,
        findings=tuple(findings),
        amplitudes=tuple(-solution[at] for at in layout.findings),
        covariances=tuple(inverse[at, at] for at in layout.findings),
        noise=noise,
        nuisance=Nuisance(columns, problem.variance),
        layout=layout,
        fitted=columns @ solution,
        solution=solution,
        inverse=inverse,
        problem=problem,
    )


def _kinematic_part(
    findings: Sequence[Candidate], columns: Sequence[F64], amplitudes: Sequence[F64]
) -> F64 | float:
    """What the findings' terms add to the linearised residual; the artefact's are not in it."""
    total: F64 | float = 0.0
    for candidate, block, values in zip(findings, columns, amplitudes, strict=True):
        terms = np.array([float(column.artefact is None) for column in candidate.columns])
        total = total + block @ (values * terms)
    return total


def _sized(
    problem: LinearModel,
    side: F64,
    layout: Layout,
    findings: Sequence[Candidate],
    sizes: Sequence[float],
) -> tuple[LinearModel, list[float]]:
    """With each curve's likely size as the data have it: expectation–maximisation, few steps."""
    sizes = list(sizes)
    curves = [i for i, candidate in enumerate(findings) if is_sized(candidate)]
    if not curves:
        return problem, sizes
    for _ in range(SIZING_STEPS):
        solution, inverse = problem.solve(side)
        variance = problem.variance.copy()
        for i in curves:
            at = layout.findings[i]
            unit = amplitude_variance(findings[i], 1.0)
            square = (solution[at] ** 2 + np.diag(inverse)[at]) / unit
            sizes[i] = float(np.clip(np.sqrt(square.mean()), *CURVE_SCALES))
            variance[at] = sizes[i] ** 2 * unit
        problem = problem.with_variance(variance)
    return problem, sizes


def _solve(blocks: Blocks, nuisance: Nuisance, layout: Layout, noise: Noise, residual: F64) -> F64:
    """Generalised least squares: solution (b,) with B x ≈ residual."""
    problem, side = _normal(blocks, nuisance.ridged(noise), layout, noise, residual)
    return problem.solve(side)[0]


def _normal(
    blocks: Blocks, nuisance: Nuisance, layout: Layout, noise: Noise, residual: F64
) -> tuple[LinearModel, F64]:
    """The linear problem of the nuisance columns, the first of *blocks*, and its right side."""
    b = layout.blocks.n
    products = blocks.products(noise.whitener, noise.distance_mm, residual)
    problem = LinearModel.of_products(
        layout.blocks, products[:b, :b], nuisance.variance, drawing=layout.drawing
    )
    return problem, products[:b, -1]

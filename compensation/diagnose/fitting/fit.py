"""A fit of one model with the findings so far to the rests, with their estimated noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import (
    CURVE_SCALE,
    CURVE_SCALES,
    CURVED_LENGTH_MM,
    CURVED_SHARE,
    MOST_CLIPPINGS,
    MOST_FIT_STEPS,
    NOISE_SETTLED,
    SHARED_ALIKE,
    SIZING_STEPS,
    TURN_SETTLED,
)
from armd.compensation.diagnose.fitting.nuisance import collect_nuisance, make_noise_variances
from armd.compensation.diagnose.noise import variances as noise_model
from armd.compensation.diagnose.noise.turns import compute_fitted_freedom, estimate_turn_ratio
from armd.compensation.diagnose.problem.amplitudes import compute_amplitude_variance, is_sized
from armd.compensation.diagnose.problem.baseline import add_findings, apply_step
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.layout import FitLayout, name_block
from armd.compensation.diagnose.problem.linear import Baseline, Linear, ModelState, Rests
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.diagnose.problem.whitening import Nuisance, RestNoise
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.linear.blocks import Blocks, to_blocks
from armd.compensation.estimate.linear.linear_model import LinearModel
from armd.compensation.model.arm import Arm


def fit(
    rests: Rests,
    arm: Arm,
    baseline: Baseline,
    model: ModelState,
    findings: Sequence[Candidate] = (),
    amplitudes: Sequence[F64] = (),
    noise_extra: Sequence[Candidate] = (),
    noise: RestNoise | None = None,
) -> Fit:
    """Fit by Gauss–Newton, estimating the noise along the way (from *noise*, where it is known).

    *noise_extra* absorbs while the noise is estimated, and only then. An effect that looks like
    noise (a steady drift) must not be counted as noise before it was tried as a cause.
    """
    amplitudes = [values.copy() for values in amplitudes]
    sizes = [CURVE_SCALE] * len(findings)
    step_number, before_this = 0, np.inf
    while True:
        step_number += 1
        linear = linearise(rests, add_findings(model, findings, amplitudes), arm)
        columns = make_finding_columns(linear, findings, arm)
        # The findings' own part is removed, so that the solution is the whole amplitude.
        residual = linear.residual - compute_kinematic_part(findings, columns, amplitudes)
        nuisance, layout = collect_nuisance(linear, arm, baseline, findings, columns, sizes)
        extra = make_finding_columns(linear, noise_extra, arm)
        variance = make_noise_variances(nuisance, layout, extra)
        blocks = to_blocks([nuisance.columns, *extra], rests.observations.placement)
        if noise is None:
            noise = noise_model.estimate(linear, residual, blocks, variance)
        clipped, noise = _clipped(linear, residual, blocks, variance, nuisance, layout, noise)
        problem, side = make_normal_equations(
            blocks, nuisance.ridged(noise), layout, noise, clipped
        )
        problem, sizes = fit_sizes(problem, side, layout, findings, sizes)
        nuisance = Nuisance(nuisance.columns, problem.variance)
        solution = problem.solve_amplitudes(side)
        fitted = nuisance.columns.times(solution)
        before = amplitudes
        amplitudes = [-solution[span] for span in layout.findings]
        shift = [
            block @ (new - old) for block, new, old in zip(columns, amplitudes, before, strict=True)
        ]
        if not baseline.is_given:
            step = -solution[layout.identified]
            shift.append(nuisance.columns.to_dense(layout.identified) @ step)
        largest = max((float(np.abs(part).max()) for part in shift), default=0.0)
        is_settled = largest**2 / CURVED_LENGTH_MM < CURVED_SHARE * noise.scale_mm
        if is_settled or step_number == MOST_FIT_STEPS or largest > before_this:
            break  # a step longer than the last one diverges: the linear answer is kept
        before_this = largest
        if not baseline.is_given:
            model = apply_step(model, baseline, step)
    return Fit(
        baseline=baseline,
        linear=linear,
        model=model,
        findings=tuple(findings),
        amplitudes=tuple(amplitudes),
        covariances=tuple(problem.covariance_of(span) for span in layout.findings),
        noise=noise,
        nuisance=nuisance,
        layout=layout,
        residual=clipped,
        raw_residual=residual,
        fitted=fitted,
        solution=solution,
        problem=problem,
    )


def _clipped(
    linear: Linear,
    residual: F64,
    blocks: Blocks,
    variance: F64,
    nuisance: Nuisance,
    layout: FitLayout,
    noise: RestNoise,
) -> tuple[F64, RestNoise]:
    """Return the residual (N,) winsorised about its fit, and the noise estimated from it.

    *variance*: of the amplitudes while the noise is estimated.
    """

    def fitted_to(values: F64, rest_noise: RestNoise) -> F64:
        return nuisance.columns.times(_solve(blocks, nuisance, layout, rest_noise, values))

    clipped = noise_model.clip_gross(residual, noise, fitted_to)
    for _ in range(MOST_CLIPPINGS):
        larger, shared, ratio = noise.scale_mm, noise.shared_part, noise.turn_ratio
        noise = noise_model.estimate(linear, clipped, blocks, variance, noise)
        fitted = fitted_to(clipped, noise)
        clipped = noise_model.clip_residual(residual, fitted, noise)
        noise = noise_model.add_shared_part(noise, linear, clipped - fitted)
        alike = abs(noise.shared_part - shared) < SHARED_ALIKE
        if noise.turned is not None:
            problem, _ = make_normal_equations(
                blocks, nuisance.ridged(noise), layout, noise, clipped - fitted
            )
            fitted_freedom = compute_fitted_freedom(nuisance.columns, problem.covariance, noise)
            ratio = estimate_turn_ratio(noise, linear, clipped - fitted, fitted_freedom)
            alike &= abs(np.log(ratio / noise.turn_ratio)) < TURN_SETTLED
        if noise.scale_mm > NOISE_SETTLED * larger and alike:
            break
        noise = replace(noise, turn_ratio=ratio)
    return clipped, noise


def compute_kinematic_part(
    findings: Sequence[Candidate], columns: Sequence[F64], amplitudes: Sequence[F64]
) -> F64 | float:
    """Return what the findings' terms add to the linearised residual.

    Changes of the artefact and effects of a joint's use are not included.
    """
    total: F64 | float = 0.0
    for candidate, block, values in zip(findings, columns, amplitudes, strict=True):
        terms = np.array(
            [float(column.artefact is None and column.use is None) for column in candidate.columns]
        )
        total = total + block @ (values * terms)
    return total


def fit_sizes(
    problem: LinearModel,
    side: F64,
    layout: FitLayout,
    findings: Sequence[Candidate],
    sizes: Sequence[float],
) -> tuple[LinearModel, list[float]]:
    """Estimate each curve's likely size from the data, by a few steps of expectation–maximisation.

    Returns the problem with the priors of these sizes, and the sizes.
    """
    sizes = list(sizes)
    curves = [i for i, candidate in enumerate(findings) if is_sized(candidate)]
    if not curves:
        return problem, sizes
    determined = find_determined_columns(problem)
    reduced, variance = problem.only(determined), problem.variance.copy()
    for _ in range(SIZING_STEPS):
        solution = reduced.solve_amplitudes(side[determined])
        for i in curves:
            span = reduced.layout[name_block(i)]
            unit = compute_amplitude_variance(findings[i], 1.0)
            squares = (solution[span] ** 2 + np.diag(reduced.covariance_of(span))) / unit
            sizes[i] = float(np.clip(np.sqrt(squares.mean()), *CURVE_SCALES))
            variance[layout.findings[i]] = sizes[i] ** 2 * unit
        reduced = reduced.with_variance(variance[determined])
    return problem.with_variance(variance), sizes


def find_determined_columns(problem: LinearModel) -> I64:
    """Find the columns that rows or a prior determine; the amplitudes of the others stay 0.

    Those of a held-out placement's pose are not among them. Without them no eigenvalues are needed
    to find the determined directions; computing these would take many times as long.
    """
    finite = np.isfinite(np.minimum(problem.variance, problem.nominal_variance))
    return np.flatnonzero(finite | (problem.squared_norm > 0.0))


def _solve(
    blocks: Blocks, nuisance: Nuisance, layout: FitLayout, noise: RestNoise, residual: F64
) -> F64:
    """Return the generalised least-squares solution (b,) with B x ≈ residual."""
    problem, side = make_normal_equations(blocks, nuisance.ridged(noise), layout, noise, residual)
    return problem.solve_amplitudes(side)


def make_normal_equations(
    blocks: Blocks, nuisance: Nuisance, layout: FitLayout, noise: RestNoise, residual: F64
) -> tuple[LinearModel, F64]:
    """Return the linear problem of the nuisance columns, and its right side.

    They are the first columns of *blocks*.
    """
    b = layout.blocks.n
    products = blocks.products(noise.whitener, noise.distance_mm, residual)
    problem = LinearModel.from_products(
        layout.blocks, products[:b, :b], nuisance.variance, nominal_variance=layout.nominal_variance
    )
    return problem, products[:b, -1]

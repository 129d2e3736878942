"""One model with the findings so far, fitted to the rests with their real noise."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from armd.compensation import parameters
from armd.compensation.arm import Arm
from armd.compensation.diagnose import noise as noise_model
from armd.compensation.diagnose.baseline import Baseline, moved, scaled
from armd.compensation.diagnose.evidence import pseudo_inverse_factor
from armd.compensation.diagnose.noise import Absorbing, Noise
from armd.compensation.diagnose.problem import Linear, ModelState, Rests, linearise
from armd.compensation.diagnose.signatures import compile_candidates
from armd.compensation.effects.effect import Candidate
from armd.compensation.terms import Temperature, Term

F64 = npt.NDArray[np.float64]

#: A step errs by about its square over the arm's length; beyond this share of the noise the
#: model is linearised anew.
CURVED_SHARE = 0.1
LENGTH_MM = 200.0
MOST_STEPS = 6
#: Findings of more columns than this are curves, whose amplitudes share one likely size: this
#: many times the catalogue's to begin with, then the data's own (empirical Bayes).
MOST_FREE_COLUMNS = 6
CURVE_SCALE = 3.0
CURVE_SCALES = (0.3, 100.0)
SIZING_STEPS = 6
#: Where the data leave constants open (the last joint's turn against the tip's offset), the
#: solution nearest to the model under test is taken: as if each were known this well.
GAUGE = {"mm": 1.0, "rad": 2e-3}
PER_KELVIN = 0.1  # of that, for the slope of a term


@dataclass(frozen=True)
class Layout:
    """Which of the absorbing columns belong to whom."""

    identified: slice  # constants and terms (when held: the directions of their covariance)
    findings: tuple[slice, ...]
    mount: slice  # one column or none: the first link's growth, see `mount_term`
    shared: int  # first of those that targets and drift share
    gauge: F64  # (identified,) variance with which to choose where the data leave it open


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
    absorbing: Absorbing
    layout: Layout
    residual: F64  # (N,) before anything absorbs, winsorised about the fit
    raw_residual: F64  # (N,) the same as measured
    fitted: F64  # (N,) of it what the absorbing columns explain
    solution: F64  # (b,)
    inverse: F64  # (b, b) covariance of the solution

    @cached_property
    def white(self) -> tuple[F64, F64, F64]:
        """Whitened absorbing columns (N, b) of unit length, by what they were divided, and their
        products (b, b)."""
        normal = _normal(self.absorbing, self.noise, self.residual)
        return normal.white, normal.scale, normal.gram

    def net_signature(self, index: int) -> F64:
        """Motion (n, 3) in mm of the tip by a finding, clear of all else that absorbs."""
        own = self.layout.findings[index]
        moves = -self.absorbing.columns[:, own] @ self.amplitudes[index]
        keep = np.delete(np.arange(len(self.solution)), own)
        white, scale, gram = self.white
        variance = _with_gauge(self.absorbing.variance, self.layout)[keep]
        ridge = np.diag(1.0 / (variance * scale[keep] ** 2))
        factor = pseudo_inverse_factor(gram[np.ix_(keep, keep)] + ridge)
        side = (white.T @ self.noise.whiten(moves))[keep]
        taken = self.absorbing.columns[:, keep] @ (factor @ (factor.T @ side) / scale[keep])
        net: F64 = (moves - taken)[: 3 * self.linear.rests.n].reshape(-1, 3)
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
        signatures.block(linear, linear.jacobian, signatures.columns_of(i))
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
        absorbing, layout = _absorbing(linear, arm, baseline, findings, columns, sizes)
        extra = finding_columns(linear, noise_extra, arm)
        for_noise = _for_noise(absorbing, layout, extra)
        if noise is None:
            noise = noise_model.estimate(linear, residual, for_noise)
        fitted = absorbing.columns @ _solve(absorbing.ridged(noise), layout, noise, residual)[0]
        clipped = noise_model.winsorise(residual, fitted, noise)
        noise = noise_model.estimate(linear, clipped, for_noise, noise)
        fitted = absorbing.columns @ _solve(absorbing.ridged(noise), layout, noise, clipped)[0]
        clipped = noise_model.winsorise(residual, fitted, noise)
        absorbing, sizes = _sized(absorbing.ridged(noise), layout, findings, sizes, noise, clipped)
        solution, inverse = _solve(absorbing, layout, noise, clipped)
        fitted = absorbing.columns @ solution
        before = amplitudes
        amplitudes = [-solution[at] for at in layout.findings]
        shift = [
            block @ (new - old) for block, new, old in zip(columns, amplitudes, before, strict=True)
        ]
        if not baseline.held:
            step = -solution[layout.identified]
            shift.append(absorbing.columns[:, layout.identified] @ step)
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
        absorbing,
        layout,
        clipped,
        residual,
        fitted,
        solution,
        inverse,
    )


def solve_again(known: Fit, findings: Sequence[Candidate], noise: Noise, arm: Arm) -> Fit:
    """The linear problem of a fit with other findings and another noise; nothing else moves."""
    columns = finding_columns(known.linear, findings, arm)
    sizes = [CURVE_SCALE] * len(findings)
    absorbing, layout = _absorbing(known.linear, arm, known.baseline, findings, columns, sizes)
    absorbing, _ = _sized(absorbing.ridged(noise), layout, findings, sizes, noise, known.residual)
    solution, inverse = _solve(absorbing, layout, noise, known.residual)
    return replace(
        known,
        findings=tuple(findings),
        amplitudes=tuple(-solution[at] for at in layout.findings),
        covariances=tuple(inverse[at, at] for at in layout.findings),
        noise=noise,
        absorbing=absorbing,
        layout=layout,
        fitted=absorbing.columns @ solution,
        solution=solution,
        inverse=inverse,
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


def _absorbing(
    linear: Linear,
    arm: Arm,
    baseline: Baseline,
    findings: Sequence[Candidate],
    columns: Sequence[F64],
    sizes: Sequence[float],
) -> tuple[Absorbing, Layout]:
    own = baseline.columns(linear, arm)
    if baseline.held:
        own = own @ baseline.root
    targets = noise_model.target_columns(linear)
    drift = noise_model.drift_columns(linear)
    blocks = [
        Absorbing(linear.nuisance, np.full(linear.nuisance.shape[1], np.inf)),
        Absorbing(own, np.full(own.shape[1], 1.0 if baseline.held else np.inf)),
        *(
            Absorbing(block, _variance(candidate, size))
            for candidate, block, size in zip(findings, columns, sizes, strict=True)
        ),
        _column_of_the_mount(linear, baseline, arm),
        targets,
        drift,
    ]
    edges = np.cumsum([0, *(block.columns.shape[1] for block in blocks)])
    places = [slice(low, high) for low, high in itertools.pairwise(edges)]
    joined = Absorbing(
        np.hstack([block.columns for block in blocks]),
        np.concatenate([block.variance for block in blocks]),
    )
    return joined, Layout(
        places[1], tuple(places[2:-3]), places[-3], places[-2].start, _gauge(baseline, arm)
    )


def mount_term(model: ModelState, arm: Arm) -> Term | None:
    """How the first link grows per kelvin (1 mm/K), where the model under test is silent on it.

    Within one temperature that is the placement's, so a calibration leaves it out; a ramp during
    one placement shows it, and no cause is to be found in that.
    """
    silent = not any(term.parameter == "d_1" and term.basis for term in model.terms)
    weights = arm.joint[0].weights
    if not (silent and weights):
        return None
    return Term(parameter="d_1", basis=[Temperature(weights=weights)], coefficient=1.0)


def _column_of_the_mount(linear: Linear, baseline: Baseline, arm: Arm) -> Absorbing:
    term = mount_term(baseline.model, arm)  # a finding's d_1 of another basis does not count
    if term is None:
        return Absorbing(np.zeros((len(linear.residual), 0)), np.zeros(0))
    states = linear.rests.observations.states
    weights = arm.joint[0].weights
    temperature = sum(w * states.temperature_c[:, arm.sensors.index(s)] for s, w in weights.items())
    rise = np.nan_to_num(temperature - linear.model.reference_c)
    column = linear.signature(parameters.index(term.parameter, arm.n_joints), rise)
    return Absorbing(column[:, None], np.array([np.inf]))


def is_curve(candidate: Candidate) -> bool:
    """Whether it is a curve over the turn, its amplitudes held together by one likely size."""
    return candidate.cause == "encoder_periodic" and len(candidate.columns) > MOST_FREE_COLUMNS


def _variance(candidate: Candidate, size: float) -> F64:
    """Amplitudes are free, those of a curve of a size in units of the catalogue's."""
    if not is_curve(candidate):
        return np.full(len(candidate.columns), np.inf)
    return np.array([(size * column.typical) ** 2 for column in candidate.columns])


def _sized(
    absorbing: Absorbing,
    layout: Layout,
    findings: Sequence[Candidate],
    sizes: Sequence[float],
    noise: Noise,
    residual: F64,
) -> tuple[Absorbing, list[float]]:
    """With each curve's likely size as the data have it: expectation–maximisation, few steps."""
    sizes = list(sizes)
    curves = [i for i, candidate in enumerate(findings) if is_curve(candidate)]
    if not curves:
        return absorbing, sizes
    normal = _normal(absorbing, noise, residual)
    variance = absorbing.variance.copy()
    for _ in range(SIZING_STEPS):
        solution, inverse = normal.solved(_with_gauge(variance, layout))
        for i in curves:
            at = layout.findings[i]
            unit = _variance(findings[i], 1.0)
            square = (solution[at] ** 2 + np.diag(inverse)[at]) / unit
            sizes[i] = float(np.clip(np.sqrt(square.mean()), *CURVE_SCALES))
            variance[at] = sizes[i] ** 2 * unit
    return Absorbing(absorbing.columns, variance), sizes


def _for_noise(absorbing: Absorbing, layout: Layout, extra: Sequence[F64]) -> Absorbing:
    """What absorbs while the noise is estimated: findings freely, curves too."""
    variance = absorbing.variance.copy()
    for at in layout.findings:
        variance[at] = np.inf
    free = [np.full(block.shape[1], np.inf) for block in extra]
    return Absorbing(np.hstack([absorbing.columns, *extra]), np.concatenate([variance, *free]))


def _gauge(baseline: Baseline, arm: Arm) -> F64:
    if baseline.held:
        return np.full(baseline.root.shape[1], np.inf)
    names = parameters.names(arm.n_joints)
    constants = [GAUGE[parameters.unit(names[i])] for i in baseline.parameters]
    own = [baseline.model.terms[i].parameter for i in baseline.terms]
    slopes = [PER_KELVIN * GAUGE[parameters.unit(name)] for name in own]
    return np.square([*constants, *slopes])


def _solve(absorbing: Absorbing, layout: Layout, noise: Noise, residual: F64) -> tuple[F64, F64]:
    """Generalised least squares: solution (b,) with B x ≈ residual, and its covariance (b, b)."""
    variance = _with_gauge(absorbing.variance, layout)
    return _normal(absorbing, noise, residual).solved(variance)


def _with_gauge(variance: F64, layout: Layout) -> F64:
    at = layout.identified
    held = variance.copy()
    held[at] = np.minimum(held[at], layout.gauge)
    return held


@dataclass(frozen=True)
class _Normal:
    """Normal equations of *white* columns, divided by *scale* (b,), to solve under any prior."""

    white: F64  # (N, b)
    gram: F64  # (b, b)
    side: F64  # (b,)
    scale: F64

    def solved(self, variance: F64) -> tuple[F64, F64]:
        """Solution (b,) and its covariance (b, b), amplitudes a priori of *variance* (b,)."""
        ridge = np.diag(1.0 / (variance * self.scale**2))
        factor = pseudo_inverse_factor(self.gram + ridge)
        inverse = factor @ factor.T / np.outer(self.scale, self.scale)
        return inverse @ (self.scale * self.side), inverse


def _normal(absorbing: Absorbing, noise: Noise, residual: F64) -> _Normal:
    white = noise.whiten(absorbing.columns)
    scale = np.sqrt((white**2).sum(axis=0))
    scale[scale == 0.0] = 1.0
    white /= scale
    return _Normal(white, white.T @ white, white.T @ noise.whiten(residual), scale)

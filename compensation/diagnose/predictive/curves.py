"""Curves of residuals along each component over each variable, and the band that noise makes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import bdtrc
from threadpoolctl import threadpool_limits

from armd.arrays import F32, F64
from armd.compensation.diagnose.constants import (
    BEYOND,
    BEYOND_FLAT,
    BEYOND_VALUES,
    CURVES,
    CURVES_AT_ONCE,
    CURVES_SEED,
    ENOUGH_CURVES,
    HALF_WIDTH,
    LEAST_CORRELATED,
    LEAST_POSITIVE,
    LEAST_SQUARE,
    LEAST_VARIANCE_SHARE,
    MOST_TOGETHER,
    ORDER_DIGITS,
    ROUNDING,
    SETS_SHOWN,
    SHARE_BEYOND,
    SHARE_OF_NAMES,
)
from armd.compensation.diagnose.diagnosis import Diagnosis, SearchResult
from armd.compensation.diagnose.predictive.bins import Bins, make_bins
from armd.compensation.diagnose.predictive.components import Component, make_components
from armd.compensation.diagnose.predictive.scores import (
    compute_misfit,
    compute_scores,
    solve_with_noise,
)
from armd.compensation.diagnose.predictive.strength import (
    Scatter,
    Strength,
    compute_strengths,
    compute_strengths_of_pairs,
    make_features,
    make_lines,
)
from armd.compensation.diagnose.predictive.sums import Functions, FunctionSums
from armd.compensation.diagnose.predictive.waves import Waves, make_waves
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.estimate.linear.blocks import Blocks


@dataclass(frozen=True, kw_only=True)
class ResidualCurve:
    """The mean residual of a model along one component over one variable, and its band.

    The band is that of data sets drawn from the model. Units are those of the component: rad, mm or
    none.
    """

    mean: F64  # (B,) of each bin
    covariance: F64  # (B, B) of the mean among data sets; (B,) variances if there are many bins
    outside: float  # the share of bins outside the band
    p_value: float  # probability that a data set of the model has so large a share
    weight: F64  # (B,) square of the tip's motion with the component, summed over each bin
    rests: int
    strength: Strength

    @property
    def band(self) -> F64:
        """The half-width (B,) about 0 that holds the means of 95 % of all data sets."""
        return HALF_WIDTH * np.sqrt(_get_variances(self.covariance))

    @property
    def sets(self) -> F64:
        """The means (r, B) of a few data sets."""
        normal = np.random.default_rng(CURVES_SEED).normal(size=(len(self.mean), SETS_SHOWN))
        sigma = np.sqrt(_get_variances(self.covariance))
        if self.covariance.ndim == 2:
            normal = _make_factor(self.covariance) @ normal
        sets: F64 = (sigma[:, None] * normal).T
        return sets

    @property
    def rms_um(self) -> float:
        """The 3-D RMS in µm of the tip's residuals that the curve explains beyond noise.

        Of curves that are wholly outside their band, that of the variable on which the error
        depends has the largest.
        """
        beyond_noise = self.mean**2 - _get_variances(self.covariance)
        explained_mm2 = max(float(self.weight @ beyond_noise), 0.0)
        return 1e3 * float(np.sqrt(explained_mm2 / self.rests))


@dataclass(frozen=True)
class ResidualComparison:
    """One variable and component, under the model under test and with the findings."""

    bins: Bins
    component: Component
    before: ResidualCurve
    after: ResidualCurve

    @property
    def order(self) -> tuple[float, bool]:
        """The sort key: comparisons that stand out of noise most come first.

        An error that is the same for all values of a variable is attributed to the time since the
        calibration.
        """
        strength, name = self.before.strength, self.bins.variable
        if name != "time_s" and strength.best <= (1.0 + SHARE_BEYOND) * strength.flat + BEYOND_FLAT:
            return (-round(strength.flat, ORDER_DIGITS), True)
        if self.bins.kind == "name":
            return (
                -round((1.0 - SHARE_OF_NAMES) * strength.best - BEYOND_VALUES, ORDER_DIGITS),
                True,
            )
        return (-round(strength.best, ORDER_DIGITS), name != "time_s")

    def as_json(self) -> dict[str, str | float | list[str]]:
        """Return an entry of `predictive`."""
        return {
            "variable": self.bins.variable,
            "component": self.component.name,
            "alike": list(self.bins.alike),
            "outside_before": self.before.outside,
            "outside_after": self.after.outside,
            "p_before": self.before.p_value,
            "p_after": self.after.p_value,
            "noise_units_before": self.before.strength.noise_units,
            "noise_units_after": self.after.strength.noise_units,
            "curve_um_before": self.before.rms_um,
            "curve_um_after": self.after.rms_um,
        }


@dataclass(frozen=True)
class CurveLayout:
    """The variables and sums over which curves are made, the same for every model."""

    variables: list[Bins]
    sums: FunctionSums  # over each variable, and over lines in the temperatures together
    warm: list[int]  # which variables are the temperatures of the arm's sensors
    waves: Waves
    normal: F32  # (B, r) random numbers from which p-values are computed


def make_layout(variables: list[Bins], blocks: Blocks) -> CurveLayout:
    """Make the layout for *variables* at the rests of *blocks*, the columns of any model."""
    warm = [
        i
        for i, bins in enumerate(variables)
        if bins.kind == "temperature" and bins.variable != "artefact_c"
    ]
    most_bins = max(
        (size for bins in variables if (size := len(bins.starts)) <= MOST_TOGETHER), default=0
    )
    normal = np.random.default_rng(CURVES_SEED).normal(size=(most_bins, CURVES))
    pieces = [piece.rests for piece in blocks.pieces]
    functions = [Functions.from_features(make_features(bins), bins, blocks.n) for bins in variables]
    lines = Functions.from_columns(make_lines([variables[i] for i in warm], blocks.n))
    return CurveLayout(
        variables,
        FunctionSums([*functions, lines], pieces),
        warm,
        make_waves(variables, blocks.n),
        normal.astype(np.float32),
    )


@dataclass(frozen=True)
class ModelSums:
    """Sums of a model's residuals and their scatter, in units of each rest's noise."""

    by_component: list[list[tuple[F64, Scatter]]]  # by component, then by variable
    strengths: list[list[Strength]]  # by variable, then by component
    levers: list[F64]  # by variable (B, K): squares of the component's motion
    weights: list[F64]  # the same in mm²
    spread: F64  # (K,) scatter of the residuals over that of the model's data sets


def compare(diagnosis: Diagnosis) -> list[ResidualComparison]:
    """Compare every variable with every component, in the noise of the last fit.

    Comparisons that stand out of noise most under the model under test come first.
    """
    with threadpool_limits(limits=1, user_api="blas"):  # small matrices: threads cost time
        return _compare(diagnosis.search)


def _compare(search: SearchResult) -> list[ResidualComparison]:
    last = search.last
    variables = make_bins(last.linear.rests)
    if not variables:
        return []
    layout = make_layout(variables, last.nuisance.columns)
    last_sums = _sum_up(solve_with_noise(last, last.noise), layout)
    after = _make_curves(last_sums, layout, last_sums.spread)
    before = after
    if last.findings or search.first is not last:
        first_sums = _sum_up(solve_with_noise(search.first, last.noise), layout)
        before = _make_curves(first_sums, layout, last_sums.spread)
    named, _ = make_components(last.linear)
    places = [(bins, component) for bins in variables for component in named]
    comparisons = [
        ResidualComparison(bins, component, first_curve, last_curve)
        for (bins, component), first_curve, last_curve in zip(places, before, after, strict=True)
    ]
    return sorted(comparisons, key=lambda comparison: comparison.order)


def _sum_up(fit: Fit, layout: CurveLayout) -> ModelSums:
    """Sum up component by component: the products of all together are large."""
    named, moves = make_components(fit.linear)  # (n, 3, K)
    misfit = compute_misfit(fit)
    number = {bins.variable: i for i, bins in enumerate(layout.variables)}
    joint = np.full((len(layout.variables), len(named)), -np.inf)
    by_component, squared_norms, spread = [], [], []
    for k, (component, score) in enumerate(zip(named, compute_scores(fit, moves), strict=True)):
        *of_variables, lines = score.sum_over(layout.sums)
        by_component.append(of_variables)
        squared_norms.append(score.squared_norm)
        spread.append(score.spread)
        if len(layout.warm) > 1:
            joint[layout.warm, k] = compute_strengths_of_pairs(*lines, misfit)
        if component.name.startswith("angle"):
            name = component.name.replace("angle joint ", "q")
            for variable, strength in layout.waves.strengths(score, name, misfit).items():
                joint[number[variable], k] = strength
    strengths = []
    for bins, joint_of_bins, scored in zip(
        layout.variables, joint, zip(*by_component, strict=True), strict=True
    ):
        values, scatters = zip(*scored, strict=True)
        strengths.append(
            compute_strengths(
                bins, np.array(values), Scatter.stack(scatters), misfit, joint_of_bins
            )
        )
    *levers, _ = layout.sums.sum_over_bins(np.stack(squared_norms, axis=1))
    *weights, _ = layout.sums.sum_over_bins((moves**2).sum(axis=1))
    return ModelSums(by_component, strengths, levers, weights, np.array(spread))


def _make_curves(sums: ModelSums, layout: CurveLayout, spread: F64) -> list[ResidualCurve]:
    """Make the curves, variable by variable and then by component.

    *spread* (K,): factors of each component's noise.
    """
    curves = []
    for v, bins in enumerate(layout.variables):
        for k, of_variables in enumerate(sums.by_component):
            values, scatter = of_variables[v]
            bins_alone = slice(len(values) - len(bins.starts), None)
            covariance = scatter.covariance[(bins_alone,) * scatter.covariance.ndim]
            # The variance of a bin whose sum is wholly absorbed is rounding.
            least_variance = LEAST_VARIANCE_SHARE * scatter.unabsorbed[bins_alone]
            is_clear = _get_variances(covariance) > least_variance
            covariance = covariance * (
                is_clear if covariance.ndim == 1 else np.outer(is_clear, is_clear)
            )
            lever = np.maximum(sums.levers[v][:, k], LEAST_SQUARE)
            lever_products = lever**2 if covariance.ndim == 1 else np.outer(lever, lever)
            mean = is_clear * values[bins_alone] / lever
            covariance = spread[k] ** 2 * covariance / lever_products
            outside = float(
                (np.abs(mean) > HALF_WIDTH * np.sqrt(_get_variances(covariance))).mean()
            )
            curves.append(
                ResidualCurve(
                    mean=mean,
                    covariance=covariance,
                    outside=outside,
                    p_value=_compute_p_value(outside, covariance, layout.normal),
                    weight=sums.weights[v][:, k],
                    rests=len(bins.order),
                    strength=sums.strengths[v][k],
                )
            )
    return curves


def _get_variances(covariance: F64) -> F64:
    """Return the variances (B,) of a covariance (B, B), or of variances (B,) alone."""
    variances = covariance if covariance.ndim == 1 else np.diag(covariance)
    return np.maximum(variances, 0.0)


def _make_factor(covariance: F64) -> F64:
    """Return a factor (B, B) that gives independent unit noise this *covariance*."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), LEAST_POSITIVE))
    correlation = covariance / np.outer(sigma, sigma)
    # What is absorbed leaves no variance in some direction, or by rounding less than none.
    correlation.flat[:: len(sigma) + 1] += LEAST_CORRELATED
    return np.linalg.cholesky(correlation)


def _compute_p_value(outside: float, covariance: F64, normal: F32) -> float:
    """Return the probability that a curve of noise has so large a share *outside* its band.

    Curves are drawn by the *covariance* (B, B) of data sets. Bins with variances (B,) alone count
    as independent.
    """
    if not outside:
        return 1.0
    if covariance.ndim == 1:
        return float(bdtrc(round(outside * len(covariance)) - 1, len(covariance), BEYOND))
    factor = _make_factor(covariance).astype(np.float32)
    least_beyond = (outside - ROUNDING) * len(factor)
    exceeding = drawn = 0
    for first in range(0, CURVES, CURVES_AT_ONCE):  # so many as a processor's cache holds
        curves = factor @ normal[: len(factor), first : first + CURVES_AT_ONCE]
        is_beyond = np.abs(curves, out=curves) > HALF_WIDTH
        exceeding += int(np.count_nonzero(is_beyond.sum(axis=0, dtype=np.uint8) >= least_beyond))
        drawn += curves.shape[1]
        if exceeding >= ENOUGH_CURVES:
            break
    return exceeding / drawn

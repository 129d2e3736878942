"""Residuals along each component over each variable, inside or outside of what noise makes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import bdtrc

from armd.arrays import F32, F64
from armd.compensation.diagnose.constants import (
    BEYOND,
    BEYOND_FLAT,
    BEYOND_VALUES,
    CURVES,
    CURVES_AT_ONCE,
    CURVES_SEED,
    HALF_WIDTH,
    LEAST_POSITIVE,
    LEAST_SQUARE,
    LEAST_SUM,
    MOST_TOGETHER,
    ORDER_DIGITS,
    ROUNDING,
    SHARE_BEYOND,
    SHARE_OF_NAMES,
)
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.predictive.bins import Bins, make_bins
from armd.compensation.diagnose.predictive.components import Component, make_components
from armd.compensation.diagnose.predictive.moments import Moments
from armd.compensation.diagnose.predictive.replicates import Refitted, solve_again
from armd.compensation.diagnose.predictive.scores import compute_misfit, compute_scores
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


@dataclass(frozen=True, kw_only=True)
class ResidualCurve:
    """What a model leaves along one component over one variable, and drawn sets' band: in rad, mm
    or without a unit, as the component."""

    mean: F64  # (B,) of each bin
    low: F64  # (B,)
    high: F64  # (B,)
    outside: float  # the share of bins outside of the band
    p_value: float  # that a drawn set has so large a share
    sets: F64  # (r, B) a few drawn sets
    draws: int  # sets in all
    weight: F64  # (B,) square of the tip's motion with the component, summed over each bin
    rests: int
    strength: Strength

    @property
    def rms_um(self) -> float:
        """3-D RMS in µm of what the curve explains of the tip's residuals, beyond what noise makes:
        of curves that are wholly outside, the one that the error goes by has the largest."""
        sigma = (self.high - self.low) / (2.0 * HALF_WIDTH)
        beyond_noise = float((self.weight * (self.mean**2 - sigma**2)).sum())
        return 1e3 * float(np.sqrt(max(beyond_noise, 0.0) / self.rests))


@dataclass(frozen=True)
class ResidualComparison:
    """One variable and component, under the model under test and with the findings."""

    bins: Bins
    component: Component
    before: ResidualCurve
    after: ResidualCurve

    @property
    def order(self) -> tuple[float, bool]:
        """What comparisons are sorted by: what stands out most stands first. What is the same all
        over is of the time since the calibration."""
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
        """An entry of `predictive`."""
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
    """What curves are made over: the same for every model."""

    variables: list[Bins]
    sums: FunctionSums  # over each variable
    warm: list[int]  # which variables are the temperatures of the arm's sensors
    lines: FunctionSums  # over these temperatures together
    waves: Waves
    normal: F32  # (B, r) random numbers that p-values are drawn by


def make_layout(variables: list[Bins], rests: int) -> CurveLayout:
    """Over *variables* at so many *rests*."""
    warm = [
        i
        for i, bins in enumerate(variables)
        if bins.kind == "temperature" and bins.variable != "artefact_c"
    ]
    most_bins = max(
        (size for bins in variables if (size := len(bins.starts)) <= MOST_TOGETHER), default=0
    )
    normal = np.random.default_rng(CURVES_SEED).normal(size=(most_bins, CURVES))
    return CurveLayout(
        variables,
        FunctionSums(
            [Functions.from_features(make_features(bins), bins, rests) for bins in variables]
        ),
        warm,
        FunctionSums([Functions.from_columns(make_lines([variables[i] for i in warm], rests))]),
        make_waves(variables, rests),
        normal.astype(np.float32),
    )


def compare(diagnosis: Diagnosis) -> list[ResidualComparison]:
    """Every variable with every component, by the noise that the last fit found; what stands out
    of noise most under the model under test stands first."""
    search = diagnosis.search
    last = search.last
    variables = make_bins(last.linear.rests)
    if not variables:
        return []
    layout = make_layout(variables, last.linear.rests.n)
    fitted = solve_again(last, last.noise)
    scale = _compute_noise_scale(fitted)
    after = _make_curves(fitted, layout, scale)
    alike = not last.findings and search.first is last
    before = after if alike else _make_curves(solve_again(search.first, last.noise), layout, scale)
    named, _ = make_components(last.linear)
    places = [(bins, component) for bins in variables for component in named]
    comparisons = [
        ResidualComparison(bins, component, first, second)
        for (bins, component), first, second in zip(places, before, after, strict=True)
    ]
    return sorted(comparisons, key=lambda comparison: comparison.order)


def _compute_noise_scale(last: Refitted) -> F64:
    """(K,) by how much more the last fit's residuals scatter along each component than drawn sets
    do: the noise found is right over all, not along each."""
    _, moves = make_components(last.fit.linear)
    measured = (np.einsum("nij,ni->jn", moves, last.residual_mm) ** 2).sum(axis=1)
    sets = next(last.draw_replicates())
    drawn = (np.einsum("ni,nir->nr", along, sets) for along in moves.transpose(2, 0, 1))
    expected = np.array([(along**2).sum(axis=0).mean() for along in drawn])
    scale: F64 = np.sqrt(np.maximum(measured, LEAST_SUM) / np.maximum(expected, LEAST_SUM))
    return scale


def _make_curves(model: Refitted, layout: CurveLayout, scale: F64) -> list[ResidualCurve]:
    """Bins by bins, component by component, whose noise is so many times that found."""
    named, moves = make_components(model.fit.linear)  # (n, 3, K)
    count = moves.shape[2]
    drawn = [Moments(len(bins.starts), count) for bins in layout.variables]
    for residual_mm in model.draw_replicates():
        for k in range(count):  # one after the other: all together are large
            along = np.einsum("ni,nir->nr", scale[k] * moves[:, :, k], residual_mm)
            for moments, sums in zip(drawn, layout.sums.sum_over_bins(along), strict=True):
                moments.add(k, sums)
    measured = np.einsum("nij,ni->nj", moves, model.residual_mm)
    curves = []
    for bins, moments, levers, sums, strong in zip(
        layout.variables,
        drawn,
        layout.sums.sum_over_bins((moves**2).sum(axis=1)),  # (B, K)
        layout.sums.sum_over_bins(measured),
        _compute_strengths(model, layout, named, moves),
        strict=True,
    ):
        levers = np.maximum(levers, LEAST_SQUARE)
        curves += [
            _make_curve(bins, levers[:, k], sums[:, k], moments, k, layout.normal, strong[k])
            for k in range(count)
        ]
    return curves


def _compute_strengths(
    model: Refitted, layout: CurveLayout, named: list[Component], moves: F64
) -> list[list[Strength]]:
    """Of each variable, of each component."""
    misfit = compute_misfit(model)
    number = {bins.variable: i for i, bins in enumerate(layout.variables)}
    joint = np.full((len(layout.variables), len(named)), -np.inf)
    by_component = []
    for k, (component, score) in enumerate(zip(named, compute_scores(model, moves), strict=True)):
        by_component.append(score.sum_over(layout.sums))
        if len(layout.warm) > 1:
            [lines] = score.sum_over(layout.lines)
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
    return strengths


def _make_curve(
    bins: Bins, lever: F64, sums: F64, drawn: Moments, k: int, normal: F32, strong: Strength
) -> ResidualCurve:
    """Of the component *k*, by measured *sums* (B,)."""
    moments = drawn.covariance(k)
    sigma = np.sqrt(np.diag(moments) if moments.ndim == 2 else moments)
    outside = float((np.abs(sums) > HALF_WIDTH * sigma).mean())
    band = HALF_WIDTH * sigma / lever
    return ResidualCurve(
        mean=sums / lever,
        low=-band,
        high=band,
        outside=outside,
        p_value=_compute_p_value(outside, moments, normal),
        sets=(drawn.first_sums[k] / lever[:, None]).T,
        draws=drawn.draws,
        weight=lever,
        rests=len(bins.order),
        strength=strong,
    )


def _compute_p_value(outside: float, moments: F64, normal: F32) -> float:
    """That a curve of noise has so large a share *outside* its band: of curves drawn by the
    covariance (B, B) of the sets, or of independent bins (B,)."""
    if moments.ndim == 1:
        n_outside = round(outside * len(moments))
        return float(bdtrc(n_outside - 1, len(moments), BEYOND)) if n_outside else 1.0
    sigma = np.sqrt(np.maximum(np.diag(moments), LEAST_POSITIVE))
    root, turned = np.linalg.eigh(moments / np.outer(sigma, sigma))
    factor = (turned * np.sqrt(np.maximum(root, 0.0))).astype(np.float32)
    least_beyond = (outside - ROUNDING) * len(factor)
    exceeding = drawn = 0
    for first in range(0, CURVES, CURVES_AT_ONCE):  # so many as a processor's cache holds
        curves = factor @ normal[: len(factor), first : first + CURVES_AT_ONCE]
        is_beyond = np.abs(curves, out=curves) > HALF_WIDTH
        exceeding += int(np.count_nonzero(is_beyond.sum(axis=0, dtype=np.uint8) >= least_beyond))
        drawn += curves.shape[1]
        if exceeding > BEYOND * CURVES_AT_ONCE:  # it is known to a tenth of itself
            break
    return exceeding / drawn

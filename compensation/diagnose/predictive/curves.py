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
    CURVES_SEED,
    FIRST_CURVES,
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
from armd.compensation.diagnose.predictive.bins import Bins, all_bins
from armd.compensation.diagnose.predictive.components import Component, components
from armd.compensation.diagnose.predictive.moments import Moments
from armd.compensation.diagnose.predictive.replicates import Refitted, refit
from armd.compensation.diagnose.predictive.scores import compute_misfit, compute_scores
from armd.compensation.diagnose.predictive.strength import (
    Strength,
    compute_strengths_of_pairs,
    features,
    lines_together,
    strength,
)
from armd.compensation.diagnose.predictive.waves import make_waves


@dataclass(frozen=True)
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
        square = float((self.weight * (self.mean**2 - sigma**2)).sum())
        return 1e3 * float(np.sqrt(max(square, 0.0) / self.rests))


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
        found, name = self.before.strength, self.bins.variable
        if name != "time_s" and found.best <= (1.0 + SHARE_BEYOND) * found.flat + BEYOND_FLAT:
            return (-round(found.flat, ORDER_DIGITS), True)
        if self.bins.kind == "name":
            return (-round((1.0 - SHARE_OF_NAMES) * found.best - BEYOND_VALUES, ORDER_DIGITS), True)
        return (-round(found.best, ORDER_DIGITS), name != "time_s")

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


def compare(diagnosis: Diagnosis) -> list[ResidualComparison]:
    """Every variable with every component, by the noise that the last fit found; what stands out
    of noise most under the model under test stands first."""
    search = diagnosis.search
    last = search.last
    bins = all_bins(last.linear.rests)
    fitted = refit(last, last.noise)
    scale = _noise_scale(fitted)
    after = _curves(fitted, bins, scale)
    alike = not last.findings and search.first is last
    before = after if alike else _curves(refit(search.first, last.noise), bins, scale)
    named, _ = components(last.linear)
    places = [(one, component) for one in bins for component in named]
    made = [
        ResidualComparison(one, component, first, second)
        for (one, component), first, second in zip(places, before, after, strict=True)
    ]
    return sorted(made, key=lambda one: one.order)


def _noise_scale(last: Refitted) -> F64:
    """(K,) by how much more the last fit's residuals scatter along each component than drawn sets
    do: the noise found is right over all, not along each."""
    _, moves = components(last.fit.linear)
    measured = (np.einsum("nij,ni->jn", moves, last.left_mm) ** 2).sum(axis=1)
    sets = next(last.replicates())
    drawn = (np.einsum("ni,nir->nr", along, sets) for along in moves.transpose(2, 0, 1))
    expected = np.array([(along**2).sum(axis=0).mean() for along in drawn])
    scale: F64 = np.sqrt(np.maximum(measured, LEAST_SUM) / np.maximum(expected, LEAST_SUM))
    return scale


def _curves(model: Refitted, bins: list[Bins], scale: F64) -> list[ResidualCurve]:
    """Bins by bins, component by component, whose noise is so many times that found."""
    named, moves = components(model.fit.linear)  # (n, 3, K)
    square = (moves**2).sum(axis=1)
    count = moves.shape[2]
    drawn = [Moments(one.order, one.starts, len(moves), count) for one in bins]
    for left in model.replicates():
        for k in range(count):  # one after the other: all together are large
            along = np.einsum("ni,nir->nr", scale[k] * moves[:, :, k], left)
            for kept in drawn:
                kept.add(k, along)
    measured = np.einsum("nij,ni->nj", moves, model.left_mm)
    most = max((size for one in bins if (size := len(one.starts)) <= MOST_TOGETHER), default=0)
    normal: F32 = np.random.default_rng(CURVES_SEED).normal(size=(most, CURVES)).astype(np.float32)
    found = []
    for one, kept, strong in zip(bins, drawn, _strengths(model, bins, named, moves), strict=True):
        levers = np.maximum(one.sums(square), LEAST_SQUARE)  # (B, K)
        sums = kept.sums(measured)
        found += [
            _curve(one, levers[:, k], sums[:, k], kept, k, normal, strong[k]) for k in range(count)
        ]
    return found


def _strengths(
    model: Refitted, bins: list[Bins], named: list[Component], moves: F64
) -> list[list[Strength]]:
    """Of each of the bins, of each component."""
    warm = [one for one in bins if one.kind == "temperature" and one.variable != "artefact_c"]
    lines = lines_together(warm, len(moves))
    rests, none = np.arange(len(moves)), np.zeros(0, dtype=np.int64)
    curves, waves = [features(one) for one in bins], make_waves(bins, len(moves))
    misfit = compute_misfit(model)
    found: list[list[Strength]] = [[] for _ in bins]
    for component, score in zip(named, compute_scores(model, moves), strict=True):
        joint: dict[str, float] = {}
        if len(warm) > 1:
            joint |= compute_strengths_of_pairs(warm, *score.over(lines, rests, none), misfit)
        if component.name.startswith("angle"):
            joint |= waves.strengths(score, component.name.replace("angle joint ", "q"), misfit)
        for one, curve, kept in zip(bins, curves, found, strict=True):
            also = joint.get(one.variable, -np.inf)
            kept.append(strength(one, *score.over(curve, one.order, one.starts), misfit, also))
    return found


def _curve(
    bins: Bins, lever: F64, sums: F64, drawn: Moments, k: int, normal: F32, strong: Strength
) -> ResidualCurve:
    """Of the component *k*, by measured *sums* (B,)."""
    moments = drawn.covariance(k)
    sigma = np.sqrt(np.diag(moments) if moments.ndim == 2 else moments)
    outside = float((np.abs(sums) > HALF_WIDTH * sigma).mean())
    band = HALF_WIDTH * sigma / lever
    return ResidualCurve(
        sums / lever,
        -band,
        band,
        outside,
        _p_value(outside, moments, normal),
        (drawn.shown[k] / lever[:, None]).T,
        drawn.draws,
        lever,
        len(bins.order),
        strong,
    )


def _p_value(outside: float, moments: F64, normal: F32) -> float:
    """That a curve of noise has so large a share *outside* its band: of curves drawn by the
    covariance (B, B) of the sets, or of independent bins (B,)."""
    if moments.ndim == 1:
        least = round(outside * len(moments))
        return float(bdtrc(least - 1, len(moments), BEYOND)) if least else 1.0
    sigma = np.sqrt(np.maximum(np.diag(moments), LEAST_POSITIVE))
    root, turned = np.linalg.eigh(moments / np.outer(sigma, sigma))
    factor = (turned * np.sqrt(np.maximum(root, 0.0))).astype(np.float32)
    least_beyond = (outside - ROUNDING) * len(factor)
    exceeding = drawn = 0
    for first in range(0, CURVES, FIRST_CURVES):  # so many as a processor's cache holds
        curves = factor @ normal[: len(factor), first : first + FIRST_CURVES]
        is_beyond = np.abs(curves, out=curves) > HALF_WIDTH
        exceeding += int(np.count_nonzero(is_beyond.sum(axis=0, dtype=np.uint8) >= least_beyond))
        drawn += curves.shape[1]
        if first == 0 and exceeding > BEYOND * drawn:
            break
    return exceeding / drawn

"""Repeatability of an arm at one place, and drift with time and with temperature.

Each coordinate of n visits is p = c + a·t + b·T + e by ordinary least squares; the scatter of e, in
three dimensions, is the repeatability. If e is correlated from one visit to the next, the variances
of the drifts are enlarged by (1 + r)/(1 − r) of the correlation r (Bartlett, 1935).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import gammaincinv

from armd.arrays import F64

CONFIDENCE = 0.95
#: The least number of visits beyond the parameters of each coordinate that gives a scatter.
LEAST_FREEDOM = 3
#: With a smaller range of time or temperature, no drift is determined.
LEAST_SPAN_H, LEAST_SPAN_K = 1 / 60, 0.1
#: Beyond this correlation of time and temperature the two drifts are hard to separate.
ALIKE = 0.95
#: Significance of a correlation from visit to visit, in its standard deviations.
CORRELATED = 2.0


@dataclass(frozen=True)
class CoordinateDrift:
    """The drift of each coordinate, µm per unit."""

    value: F64  # (3,)
    standard_uncertainty: F64  # (3,)

    def as_json(self) -> dict[str, list[float]]:
        """Return the object of the `armd.repeatability/1` format."""
        uncertainty = self.standard_uncertainty.tolist()
        return {"value": self.value.tolist(), "standard_uncertainty": uncertainty}


@dataclass(frozen=True, kw_only=True)
class Repeatability:
    """The results of n visits of one place."""

    repeatability_um: float  # 3-D standard deviation after the drifts
    interval_um: tuple[float, float]  # 95 %
    per_h: CoordinateDrift | None  # None: the visits do not determine it
    per_k: CoordinateDrift | None
    rp_um: float  # ISO 9283: mean distance plus three standard deviations, after the drifts
    largest_um: float  # distance from the fitted drift
    offset_um: F64  # (n, 3) from the mean
    fitted_um: F64  # (n, 3) the part of the drifts
    remarks: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        axes = np.std(self.offset_um - self.fitted_um, axis=0, ddof=1)
        return {
            "schema": "armd.repeatability/1",
            "n": len(self.offset_um),
            "repeatability_um": self.repeatability_um,
            "interval_um": list(self.interval_um),
            "drift_um_per_h": None if self.per_h is None else self.per_h.as_json(),
            "drift_um_per_k": None if self.per_k is None else self.per_k.as_json(),
            "by_axis_um": axes.tolist(),
            "rp_iso9283_um": self.rp_um,
            "largest_um": self.largest_um,
            "remarks": list(self.remarks),
        }


def fit_repeatability(position_mm: F64, time_h: F64, temperature_c: F64) -> Repeatability:
    """Fit drifts and repeatability to visits (n, 3) mm at (n,) hours and (n,) °C.

    Hours or °C may be NaN where not known. Raises `ArithmeticError` for too few visits.
    """
    remarks: list[str] = []
    columns = [np.ones(len(position_mm))]
    hours = _centre_varied(time_h, LEAST_SPAN_H, "time", remarks)
    kelvin = _centre_varied(temperature_c, LEAST_SPAN_K, "temperature", remarks)
    columns += [column for column in (hours, kelvin) if column is not None]
    design = np.column_stack(columns)
    freedom = len(design) - design.shape[1]
    if freedom < LEAST_FREEDOM:
        needed = design.shape[1] + LEAST_FREEDOM
        raise ArithmeticError(f"{len(design)} visits, of {needed} at least")
    if hours is not None and kelvin is not None:
        alike = float(np.corrcoef(hours, kelvin)[0, 1])
        if abs(alike) > ALIKE:
            remarks.append(
                f"time and temperature moved together (correlation {alike:+.2f}): let the arm cool"
                " down while it is visited, to separate the two drifts"
            )
    position_um = 1e3 * (position_mm - position_mm.mean(axis=0))
    solved, _, rank, _ = np.linalg.lstsq(design, position_um, rcond=None)
    fitted = design @ solved
    residual = position_um - fitted
    covariance = residual.T @ residual / freedom
    drifts: list[CoordinateDrift] = []
    if rank == design.shape[1]:
        inverse = np.diag(np.linalg.inv(design.T @ design))
        larger = _compute_enlargement(residual, remarks)
        for i in range(1, design.shape[1]):
            spread = np.sqrt(inverse[i] * np.diag(covariance) * larger)
            drifts.append(CoordinateDrift(solved[i], spread))
    else:
        remarks.append("time and temperature moved exactly together: no drift is reported")
    by = iter(drifts)
    per_h = next(by, None) if hours is not None else None
    per_k = next(by, None) if kelvin is not None else None
    size = math.sqrt(float(np.trace(covariance)))
    distance = np.linalg.norm(residual, axis=1)
    return Repeatability(
        repeatability_um=size,
        interval_um=_compute_interval(covariance, freedom, size),
        per_h=per_h,
        per_k=per_k,
        rp_um=float(distance.mean() + 3 * distance.std(ddof=1)),
        largest_um=float(distance.max()),
        offset_um=position_um,
        fitted_um=fitted - fitted.mean(axis=0),
        remarks=tuple(remarks),
    )


def _centre_varied(values: F64, least_span: float, quantity: str, remarks: list[str]) -> F64 | None:
    """Return values minus their mean; None with a remark where they determine no drift."""
    if not np.isfinite(values).all():
        remarks.append(f"no {quantity} with every visit: no drift by {quantity}")
        return None
    if float(np.ptp(values)) < least_span:
        remarks.append(f"the {quantity} varied by {np.ptp(values):.2g}: no drift by {quantity}")
        return None
    out: F64 = values - values.mean()
    return out


def _compute_enlargement(residual: F64, remarks: list[str]) -> F64:
    """Compute the factor (3,) of the variances for correlation from visit to visit."""
    squares = np.maximum((residual**2).sum(axis=0), 1e-30)
    r = (residual[1:] * residual[:-1]).sum(axis=0) / squares
    significant = r > CORRELATED / math.sqrt(len(residual))
    if significant.any():
        remarks.append(
            f"visits are correlated with the ones before ({r.max():.2f}): the drift is no straight"
            " line; its uncertainties are enlarged"
        )
    r = np.clip(np.where(significant, r, 0.0), 0.0, 0.9)
    out: F64 = (1 + r) / (1 - r)
    return out


def _compute_interval(covariance: F64, freedom: int, size: float) -> tuple[float, float]:
    """Compute the 95 % interval by chi-squared.

    The degrees of freedom are those of the three axes together (Satterthwaite, Biometrics Bull. 2,
    1946).
    """
    square_sum = float((covariance**2).sum())
    together = freedom * size**4 / square_sum if square_sum > 0 else 3.0 * freedom
    tails = 2.0 * gammaincinv(together / 2.0, [0.5 + CONFIDENCE / 2, 0.5 - CONFIDENCE / 2])
    low, high = size * np.sqrt(together / tails)
    return float(low), float(high)


def describe_repeatability(fit: Repeatability, sensors: Sequence[str]) -> list[str]:
    """Describe the results for the console and the page; temperatures are means of *sensors*."""
    low, high = fit.interval_um
    lines = [
        f"repeatability {fit.repeatability_um / 1e3:.4f} mm (95 %: {low / 1e3:.4f} to"
        f" {high / 1e3:.4f} mm), 3-D standard deviation of {len(fit.offset_um)} visits after the"
        " drifts",
        f"ISO 9283 RP {fit.rp_um / 1e3:.4f} mm; farthest visit {fit.largest_um / 1e3:.4f} mm",
    ]
    source = f" (mean of {', '.join(sensors)})" if sensors else ""
    for drift, unit in ((fit.per_h, "h"), (fit.per_k, f"K{source}")):
        if drift is not None:
            drifts = ", ".join(
                f"{axis} {value:+.2f} ± {2 * deviation:.2f}"
                for axis, value, deviation in zip(
                    "xyz", drift.value, drift.standard_uncertainty, strict=True
                )
            )
            lines.append(f"drift {drifts} µm per {unit}, ± U (k = 2)")
    return [*lines, *(f"remark: {remark}" for remark in fit.remarks)]

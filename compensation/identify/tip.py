"""Fit a tip's offset to readings of one seat, or all over a sphere of known diameter.

With o and R the last frame's origin and rotation, the tip's centre is o + R·t. In a seat it is the
same point s each time: R·t − s = −o, linear in t and s. On a sphere of centre c its distance from c
is D/2 + r. The arm's own constants count as exact: their errors appear as form error, as far as the
postures show them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from armd.arrays import F64
from armd.compensation.features.algebraic import fit_algebraic_sphere

#: Readings beyond the unknowns, so that the scatter is an estimate and not chance.
SPARE = 2


@dataclass(frozen=True)
class TipFit:
    """The tip's offset and its uncertainty; lengths in mm."""

    offset_mm: F64  # (3,) in the last frame
    covariance_mm2: F64  # (3, 3) of the offset, from the readings' scatter
    centre_mm: F64  # (3,) of the seat or sphere, base frame
    radius_mm: float | None  # of the tip's ball; None: a seat does not determine it
    radius_uncertainty_mm: float | None  # standard
    residual_mm: F64  # (n,) distance from the seat, or signed from the sphere
    form_error_mm: float  # sphere: farthest minus nearest; seat: largest distance

    @property
    def uncertainty_mm(self) -> F64:
        """The standard uncertainty (3,) of the offset."""
        standard_deviation_mm: F64 = np.sqrt(np.maximum(np.diag(self.covariance_mm2), 0.0))
        return standard_deviation_mm

    def as_json(self) -> dict[str, Any]:
        return {
            "offset_mm": self.offset_mm.tolist(),
            "standard_uncertainty_mm": self.uncertainty_mm.tolist(),
            "covariance_mm2": self.covariance_mm2.tolist(),
            "centre_mm": self.centre_mm.tolist(),
            "radius_mm": self.radius_mm,
            "radius_standard_uncertainty_mm": self.radius_uncertainty_mm,
            "form_error_mm": self.form_error_mm,
            "rms_mm": float(np.sqrt(np.mean(self.residual_mm**2))),
            "n": len(self.residual_mm),
        }


def fit_in_seat(origin_mm: F64, rotation: F64) -> TipFit:
    """Fit the tip to last frames (n, 3), (n, 3, 3) with the tip in one seat.

    Raises `ArithmeticError` for too few readings, or postures that are too alike.
    """
    n = len(origin_mm)
    if n < 2 + SPARE:
        raise ArithmeticError(f"{n} readings, expected at least {2 + SPARE}")
    middle = origin_mm.mean(axis=0)
    minus = np.tile(-np.eye(3), (n, 1, 1))
    design = np.concatenate([rotation, minus], axis=2).reshape(3 * n, 6)
    _require_full(design)
    estimate = np.linalg.lstsq(design, (middle - origin_mm).reshape(-1), rcond=None)[0]
    away = (design @ estimate - (middle - origin_mm).reshape(-1)).reshape(n, 3)
    variance = float((away**2).sum()) / (3 * n - 6)
    covariance: F64 = variance * np.linalg.inv(design.T @ design)
    distance = np.linalg.norm(away, axis=1)
    return TipFit(
        offset_mm=estimate[:3],
        covariance_mm2=covariance[:3, :3],
        centre_mm=middle + estimate[3:],
        radius_mm=None,
        radius_uncertainty_mm=None,
        residual_mm=distance,
        form_error_mm=float(distance.max()),
    )


def fit_on_sphere(
    origin_mm: F64,
    rotation: F64,
    offset_mm: F64,
    diameter_mm: float,
    diameter_uncertainty_mm: float = 0.0,
) -> TipFit:
    """Fit the tip to last frames while its ball touched a sphere from outside, all over.

    *offset_mm* (3,) is the approximate offset of the tip. Raises `ArithmeticError` for too few
    readings, or postures and contacts that are too alike.
    """
    n = len(origin_mm)
    if n < 7 + SPARE:
        raise ArithmeticError(f"{n} readings, expected at least {7 + SPARE}")
    tip = origin_mm + rotation @ offset_mm
    middle = tip.mean(axis=0)
    origin = origin_mm - middle

    def to_centre(unknown: F64) -> F64:
        out: F64 = origin + rotation @ unknown[:3] - unknown[3:6]
        return out

    def distance(unknown: F64) -> F64:
        out: F64 = np.linalg.norm(to_centre(unknown), axis=1) - unknown[6]
        return out

    def derivatives(unknown: F64) -> F64:
        to_tip_mm = to_centre(unknown)
        normal = to_tip_mm / np.linalg.norm(to_tip_mm, axis=1, keepdims=True)
        by_offset = np.einsum("ni,nij->nj", normal, rotation)
        return np.column_stack([by_offset, -normal, np.full(n, -1.0)])

    centre, radius = fit_algebraic_sphere(tip - middle)  # through the approximate tips
    start = np.concatenate([offset_mm, centre, [radius]])
    fit = least_squares(
        distance, start, derivatives, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    slope = derivatives(fit.x)
    _require_full(slope)
    variance = float((fit.fun**2).sum()) / (n - 7)
    covariance: F64 = np.asarray(variance * np.linalg.inv(slope.T @ slope), dtype=np.float64)
    return TipFit(
        offset_mm=fit.x[:3],
        covariance_mm2=covariance[:3, :3],
        centre_mm=middle + fit.x[3:6],
        radius_mm=float(fit.x[6]) - diameter_mm / 2,
        radius_uncertainty_mm=float(
            np.hypot(np.sqrt(covariance[6, 6]), diameter_uncertainty_mm / 2)
        ),
        residual_mm=fit.fun,
        form_error_mm=float(np.ptp(fit.fun)),
    )


def _require_full(design: F64) -> None:
    """Raise `ArithmeticError` unless the postures turn the last frame about two axes."""
    size = np.linalg.norm(design, axis=0)
    if size.min() == 0 or np.linalg.cond(design / size) > MOST_CONDITION:
        raise ArithmeticError("postures too alike: turn the last frame about other axes too")


#: Beyond this condition, only rounding and the arm's errors determine a direction of the offset.
#: Postures that turn the last frame by 20° about two axes have a condition of about 12, by 5° about
#: 40.
MOST_CONDITION = 100.0

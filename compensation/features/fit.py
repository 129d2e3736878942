"""Fit point, line, plane, circle, sphere and cylinder to points by least orthogonal distances.

These are the Gaussian features of coordinate metrology (Forbes, NPL DITC 140/89; Shakarji, J. Res.
NIST 103, 1998): the sum of squared orthogonal distances is least, and every point has equal weight.
The parameters' covariance is propagated from the points' covariances, taken as independent, through
the fit's Jacobian (GUM, law of propagation). Where a point's covariance is not known, it comes from
the residuals' scatter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, get_args

import numpy as np
from scipy.optimize import least_squares

from armd.arrays import F64
from armd.compensation.features.shapes import FREE, Shape, Start, move_shape
from armd.compensation.features.starts import STARTS

SHAPES: tuple[Shape, ...] = get_args(Shape)

#: The least points that determine a shape.
LEAST: dict[Shape, int] = {
    "point": 1, "line": 2, "plane": 3, "circle": 3, "sphere": 4, "cylinder": 5,
}  # fmt: skip
#: If a direction of the parameters is worse known by this factor, the points do not determine it.
SINGULAR = 1e-9


@dataclass(frozen=True)
class Feature:
    """A fitted shape; lengths in mm, in the frame of the points."""

    shape: Shape
    point_mm: F64  # (3,) on it: a centre, or the point nearest to the points' mean
    direction: F64 | None  # (3,) unit vector: along a line or axis, normal to a plane or circle
    radius_mm: float | None
    covariance: F64 | None  # (7, 7) of point, direction, radius; None: not known
    residual_mm: F64  # (n,) orthogonal distances, signed where a side exists
    form_error_mm: float
    from_scatter: bool  # whether the covariance is from the residuals, not from the points' own

    @property
    def rms_mm(self) -> float:
        return float(np.sqrt(np.mean(self.residual_mm**2)))

    def as_json(self) -> dict[str, Any]:
        uncertain = None
        if self.covariance is not None:
            uncertain = np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).tolist()
        turned = None if self.direction is None else self.direction.tolist()
        return {
            "shape": self.shape,
            "point_mm": self.point_mm.tolist(),
            "direction": turned,
            "radius_mm": self.radius_mm,
            "point_standard_uncertainty_mm": uncertain and uncertain[:3],
            "direction_standard_uncertainty": uncertain and turned and uncertain[3:6],
            "radius_standard_uncertainty_mm": (
                uncertain[6] if uncertain and self.radius_mm is not None else None
            ),
            "uncertainty_from": "residuals" if self.from_scatter else "points",
            "form_error_mm": self.form_error_mm,
            "rms_mm": self.rms_mm,
            "n": len(self.residual_mm),
        }


def fit(shape: Shape, points_mm: F64, covariance_mm2: F64 | None = None) -> Feature:
    """Fit a feature to points (n, 3), with their covariances (n, 3, 3) where these are known.

    Raises `ArithmeticError` for too few points, or points that do not determine the shape.
    """
    n = len(points_mm)
    if n < LEAST[shape]:
        raise ArithmeticError(f"{n} points, expected at least {LEAST[shape]} for a {shape}")
    middle = points_mm.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((points_mm - middle) ** 2, axis=1)))) or 1.0
    x = (points_mm - middle) / size
    if shape != "point":
        _require_extent(shape, x)
    best: tuple[float, F64, Start] | None = None
    for start in STARTS[shape](x):
        solution = least_squares(
            partial(_residuals, shape, x, start),
            np.zeros(FREE[shape].count),
            method="lm" if n * FREE[shape].residuals_per_point >= FREE[shape].count else "trf",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        )
        if best is None or solution.cost < best[0]:
            best = float(solution.cost), solution.x, start
    assert best is not None  # every shape has a start
    optimum = move_shape(shape, best[2], best[1])
    return _described(shape, x, optimum, middle, size, covariance_mm2)


def _residuals(shape: Shape, x: F64, start: Start, u: F64) -> F64:
    """Return all residuals, flattened, of the start moved by *u*."""
    return FREE[shape].residuals(x, move_shape(shape, start, u)).ravel()


def _described(
    shape: Shape, x: F64, optimum: Start, middle: F64, size: float, covariance_mm2: F64 | None
) -> Feature:
    """Return the feature at its optimum, in millimetres, with its covariance."""
    free = FREE[shape]
    if shape in ("line", "plane", "cylinder"):  # the point nearest the mean
        along = optimum.direction if shape != "plane" else None
        foot = optimum.point if along is None else optimum.point - along * (along @ optimum.point)
        if along is None:
            foot = optimum.direction * (optimum.direction @ optimum.point)
        optimum = optimum._replace(point=foot)
    slope = _slope(shape, x, optimum)
    singular = np.linalg.svd(slope, compute_uv=False)
    if singular[-1] < SINGULAR * singular[0]:
        raise ArithmeticError(f"the points do not determine a {shape}")
    inverse = np.linalg.inv(slope.T @ slope)
    residual = free.residuals(x, optimum)
    covariance, from_scatter = None, covariance_mm2 is None
    if covariance_mm2 is not None:
        gradient = free.gradients(x, optimum)  # (n, each, 3)
        spread = np.einsum("nki,nij,nlj->nkl", gradient, covariance_mm2 / size**2, gradient)
        blocks = slope.reshape(len(x), free.residuals_per_point, free.count)
        middle_part = np.einsum("nkp,nkl,nlq->pq", blocks, spread, blocks)
        covariance = inverse @ middle_part @ inverse
    elif residual.size > free.count:
        covariance = float((residual**2).sum()) / (residual.size - free.count) * inverse
    covariance_7 = None
    if covariance is not None:
        change = _change(shape, optimum)  # (7, count)
        covariance_7 = change @ covariance @ change.T
        lengths = np.array([size, size, size, 1.0, 1.0, 1.0, size])
        covariance_7 = covariance_7 * lengths[:, None] * lengths
    distance, form = free.form(residual)
    return Feature(
        shape=shape,
        point_mm=middle + size * optimum.point,
        direction=optimum.direction if free.turned else None,
        radius_mm=abs(size * optimum.radius) if free.round else None,
        covariance=covariance_7,
        residual_mm=size * distance,
        form_error_mm=size * form,
        from_scatter=from_scatter,
    )


def _slope(shape: Shape, x: F64, optimum: Start) -> F64:
    """Compute derivatives of the residuals (n·each, count) by the free parameters."""
    count, step = FREE[shape].count, 1e-6
    columns = []
    for i in range(count):
        u = step * np.eye(count)[i]
        ahead = FREE[shape].residuals(x, move_shape(shape, optimum, u))
        behind = FREE[shape].residuals(x, move_shape(shape, optimum, -u))
        columns.append(((ahead - behind) / (2 * step)).ravel())
    return np.stack(columns, axis=1)


def _change(shape: Shape, optimum: Start) -> F64:
    """Compute derivatives (7, count) of point, direction and radius by the free parameters."""
    count, step = FREE[shape].count, 1e-6
    columns = []
    for i in range(count):
        u = step * np.eye(count)[i]
        ahead, behind = move_shape(shape, optimum, u), move_shape(shape, optimum, -u)
        columns.append((np.hstack(ahead) - np.hstack(behind)) / (2 * step))
    return np.stack(columns, axis=1)


#: The dimensions in which the points must extend.
_EXTENT: dict[Shape, int] = {"line": 1, "plane": 2, "circle": 2, "sphere": 3, "cylinder": 3}


def _require_extent(shape: Shape, x: F64) -> None:
    extent = np.linalg.svd(x, compute_uv=False)
    needed_dimensions = _EXTENT[shape]
    if (
        len(extent) < needed_dimensions
        or extent[needed_dimensions - 1] < SINGULAR * extent[0]
        or extent[0] == 0
    ):
        arrangement = ("", "at one place", "on one line", "in one plane")[needed_dimensions]
        raise ArithmeticError(f"the points lie {arrangement}: no {shape} is determined")

"""Point, line, plane, circle, sphere and cylinder through points: least orthogonal distances.

The Gaussian features of coordinate metrology (Forbes, NPL DITC 140/89; Shakarji, J. Res. NIST 103,
1998): the sum of squared orthogonal distances is least, every point counts alike. The parameters'
covariance comes from the points' own, taken as independent of each other, through the fit's
Jacobian (GUM, law of propagation); where a point's is not known, from the residuals' scatter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

F64 = npt.NDArray[np.float64]
Shape = Literal["point", "line", "plane", "circle", "sphere", "cylinder"]
SHAPES: tuple[Shape, ...] = get_args(Shape)

#: Points without which a shape is not determined.
LEAST: dict[Shape, int] = {
    "point": 1, "line": 2, "plane": 3, "circle": 3, "sphere": 4, "cylinder": 5,
}  # fmt: skip
#: A direction of the parameters known so much worse than the best one is not told by the points.
SINGULAR = 1e-9
#: Directions all over the half sphere from which a cylinder's axis is looked for. Starts within
#: about 15° of the axis converge; 120 directions leave no gap wider than that.
AXES = 120
REFINED = 4


@dataclass(frozen=True)
class Feature:
    """A fitted shape; lengths in mm, base frame or whatever the points were in."""

    shape: Shape
    point_mm: F64  # (3,) on it: a centre, or nearest to the points' mean
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


class _Start(NamedTuple):
    """Where a fit begins: a point, a direction, a radius, in centred and scaled coordinates."""

    point: F64
    direction: F64
    radius: float


def fit(shape: Shape, points_mm: F64, covariance_mm2: F64 | None = None) -> Feature:
    """The feature through points (n, 3), with their covariances (n, 3, 3) where these are known.

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
    best: tuple[float, F64, _Start] | None = None
    for start in _STARTS[shape](x):
        found = least_squares(
            partial(_residuals, shape, x, start),
            np.zeros(_FREE[shape].count),
            method="lm" if n * _FREE[shape].each >= _FREE[shape].count else "trf",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        )
        if best is None or found.cost < best[0]:
            best = float(found.cost), found.x, start
    assert best is not None  # every shape has a start
    at = _moved(shape, best[2], best[1])
    return _described(shape, x, at, middle, size, covariance_mm2)


def _residuals(shape: Shape, x: F64, start: _Start, u: F64) -> F64:
    """All in a row, of the start moved by *u*."""
    return _FREE[shape].residuals(x, _moved(shape, start, u)).ravel()


def _described(
    shape: Shape, x: F64, at: _Start, middle: F64, size: float, covariance_mm2: F64 | None
) -> Feature:
    """The feature at its optimum, in millimetres, with its covariance."""
    free = _FREE[shape]
    if shape in ("line", "plane", "cylinder"):  # of all its points the one nearest the mean
        along = at.direction if shape != "plane" else None
        foot = at.point if along is None else at.point - along * (along @ at.point)
        if along is None:
            foot = at.direction * (at.direction @ at.point)
        at = at._replace(point=foot)
    slope = _slope(shape, x, at)
    singular = np.linalg.svd(slope, compute_uv=False)
    if singular[-1] < SINGULAR * singular[0]:
        raise ArithmeticError(f"the points do not determine a {shape}")
    inverse = np.linalg.inv(slope.T @ slope)
    residual = free.residuals(x, at)
    covariance, from_scatter = None, covariance_mm2 is None
    if covariance_mm2 is not None:
        gradient = free.gradients(x, at)  # (n, each, 3)
        spread = np.einsum("nki,nij,nlj->nkl", gradient, covariance_mm2 / size**2, gradient)
        blocks = slope.reshape(len(x), free.each, free.count)
        middle_part = np.einsum("nkp,nkl,nlq->pq", blocks, spread, blocks)
        covariance = inverse @ middle_part @ inverse
    elif residual.size > free.count:
        covariance = float((residual**2).sum()) / (residual.size - free.count) * inverse
    told = None
    if covariance is not None:
        change = _change(shape, at)  # (7, count)
        told = change @ covariance @ change.T
        lengths = np.array([size, size, size, 1.0, 1.0, 1.0, size])
        told = told * lengths[:, None] * lengths
    distance, form = free.form(residual)
    return Feature(
        shape=shape,
        point_mm=middle + size * at.point,
        direction=at.direction if free.turned else None,
        radius_mm=abs(size * at.radius) if free.round else None,
        covariance=told,
        residual_mm=size * distance,
        form_error_mm=size * form,
        from_scatter=from_scatter,
    )


# --- the shapes: their residuals, what these follow, and their form ------------------------------


def _across(direction: F64) -> tuple[F64, F64]:
    """Two unit vectors square to a direction and to each other."""
    least = np.eye(3)[int(np.argmin(np.abs(direction)))]
    one = np.cross(direction, least)
    one /= np.linalg.norm(one)
    return one, np.cross(direction, one)


def _moved(shape: Shape, start: _Start, u: F64) -> _Start:
    """The shape moved by its free parameters *u*: along itself nothing changes."""
    e1, e2 = _across(start.direction)
    d = start.direction
    match shape:
        case "point":
            return start._replace(point=start.point + u)
        case "plane":
            return _Start(start.point + u[0] * d, _unit(d + u[1] * e1 + u[2] * e2), 0.0)
        case "line":
            point = start.point + u[0] * e1 + u[1] * e2
            return _Start(point, _unit(d + u[2] * e1 + u[3] * e2), 0.0)
        case "sphere":
            return _Start(start.point + u[:3], d, start.radius + u[3])
        case "circle":
            turned = _unit(d + u[3] * e1 + u[4] * e2)
            return _Start(start.point + u[:3], turned, start.radius + u[5])
        case "cylinder":
            point = start.point + u[0] * e1 + u[1] * e2
            return _Start(point, _unit(d + u[2] * e1 + u[3] * e2), start.radius + u[4])


def _slope(shape: Shape, x: F64, at: _Start) -> F64:
    """Derivatives of the residuals (n·each, count) by the free parameters."""
    count, step = _FREE[shape].count, 1e-6
    columns = []
    for i in range(count):
        u = step * np.eye(count)[i]
        ahead = _FREE[shape].residuals(x, _moved(shape, at, u))
        behind = _FREE[shape].residuals(x, _moved(shape, at, -u))
        columns.append(((ahead - behind) / (2 * step)).ravel())
    return np.stack(columns, axis=1)


def _change(shape: Shape, at: _Start) -> F64:
    """Derivatives (7, count) of point, direction and radius by the free parameters."""
    count, step = _FREE[shape].count, 1e-6
    columns = []
    for i in range(count):
        u = step * np.eye(count)[i]
        ahead, behind = _moved(shape, at, u), _moved(shape, at, -u)
        columns.append((np.hstack(ahead) - np.hstack(behind)) / (2 * step))
    return np.stack(columns, axis=1)


def _away(x: F64, at: _Start) -> F64:
    return x - at.point


def _radial(x: F64, at: _Start) -> tuple[F64, F64]:
    """Distance (n,) from the axis, and unit vectors (n, 3) from it."""
    away = _away(x, at)
    square = away - np.outer(away @ at.direction, at.direction)
    distance = np.linalg.norm(square, axis=1)
    return distance, square / np.maximum(distance, 1e-300)[:, None]


def _sphere(x: F64, at: _Start) -> F64:
    out: F64 = np.linalg.norm(_away(x, at), axis=1) - at.radius
    return out[:, None]


def _sphere_gradient(x: F64, at: _Start) -> F64:
    away = _away(x, at)
    out: F64 = away / np.linalg.norm(away, axis=1, keepdims=True)
    return out[:, None, :]


def _plane(x: F64, at: _Start) -> F64:
    out: F64 = _away(x, at) @ at.direction
    return out[:, None]


def _line(x: F64, at: _Start) -> F64:
    out: F64 = _away(x, at) @ np.stack(_across(at.direction), axis=1)
    return out


def _circle(x: F64, at: _Start) -> F64:
    return np.stack([_radial(x, at)[0] - at.radius, _away(x, at) @ at.direction], axis=1)


def _circle_gradient(x: F64, at: _Start) -> F64:
    return np.stack([_radial(x, at)[1], np.tile(at.direction, (len(x), 1))], axis=1)


def _same(rows: Callable[[_Start], F64]) -> Callable[[F64, _Start], F64]:
    """A gradient (each, 3) that is the same at every point."""
    return lambda x, at: np.tile(rows(at), (len(x), 1, 1))


def _spread(residual: F64) -> tuple[F64, float]:
    """Signed distances: farthest out minus farthest in."""
    return residual[:, 0], float(np.ptp(residual[:, 0]))


def _around(residual: F64) -> tuple[F64, float]:
    """Distances from a line: the diameter of the cylinder about it that holds the points."""
    distance = np.linalg.norm(residual, axis=1)
    return distance, 2 * float(distance.max())


def _largest(residual: F64) -> tuple[F64, float]:
    distance = np.linalg.norm(residual, axis=1)
    return distance, float(distance.max())


def _ring(residual: F64) -> tuple[F64, float]:
    """Of a circle: the radial and the axial spread, the larger one."""
    form = float(np.ptp(residual, axis=0).max())
    return np.linalg.norm(residual, axis=1), form


@dataclass(frozen=True)
class _Free:
    """What a shape's fit is made of."""

    count: int  # free parameters
    each: int  # residuals of a point
    turned: bool  # has a direction
    round: bool  # has a radius
    residuals: Callable[[F64, _Start], F64]  # (n, each)
    gradients: Callable[[F64, _Start], F64]  # (n, each, 3), by the point
    form: Callable[[F64], tuple[F64, float]]  # distances (n,), form error


_FREE: dict[Shape, _Free] = {
    "point": _Free(3, 3, False, False, _away, _same(lambda _: np.eye(3)), _largest),
    "line": _Free(
        4, 2, True, False, _line, _same(lambda at: np.stack(_across(at.direction))), _around
    ),
    "plane": _Free(3, 1, True, False, _plane, _same(lambda at: at.direction[None]), _spread),
    "circle": _Free(6, 2, True, True, _circle, _circle_gradient, _ring),
    "sphere": _Free(4, 1, False, True, _sphere, _sphere_gradient, _spread),
    "cylinder": _Free(
        5, 1, True, True,
        lambda x, at: (_radial(x, at)[0] - at.radius)[:, None],
        lambda x, at: _radial(x, at)[1][:, None, :],
        _spread,
    ),
}  # fmt: skip


# --- where the fits begin ------------------------------------------------------------------------


def _principal(x: F64) -> F64:
    """Unit vectors (3, 3), rows, the direction of the largest extent first; *x* is centred."""
    vectors: F64 = np.linalg.svd(x, full_matrices=True)[2]
    return vectors


def _flat_circle(x: F64, normal: F64) -> tuple[_Start, float]:
    """The circle through points seen along *normal*, algebraically (Kåsa), and its mean square."""
    e1, e2 = _across(normal)
    seen = np.stack([x @ e1, x @ e2], axis=1)
    design = np.column_stack([2 * seen, np.ones(len(x))])
    c1, c2, rest = np.linalg.lstsq(design, (seen**2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(rest + c1**2 + c2**2, 1e-12)))
    off = np.linalg.norm(seen - [c1, c2], axis=1) - radius
    return _Start(c1 * e1 + c2 * e2, normal, radius), float(np.mean(off**2))


def _start_sphere(x: F64) -> list[_Start]:
    design = np.column_stack([2 * x, np.ones(len(x))])
    *centre, rest = np.linalg.lstsq(design, (x**2).sum(axis=1), rcond=None)[0]
    at = np.array(centre)
    return [_Start(at, np.array([0.0, 0.0, 1.0]), float(np.sqrt(max(rest + at @ at, 1e-12))))]


def _start_cylinder(x: F64) -> list[_Start]:
    """From the directions in which the points look most like a circle."""
    i = np.arange(AXES) + 0.5
    up, around = i / AXES, np.pi * (1 + np.sqrt(5.0)) * i  # a spiral over the half sphere
    level = np.sqrt(1 - up**2)
    spiral = np.stack([level * np.cos(around), level * np.sin(around), up], axis=1)
    tried = [_flat_circle(x, direction) for direction in np.vstack([_principal(x), spiral])]
    return [start for start, _ in sorted(tried, key=lambda pair: pair[1])[:REFINED]]


_STARTS: dict[Shape, Callable[[F64], list[_Start]]] = {
    "point": lambda x: [_Start(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0)],
    "line": lambda x: [_Start(np.zeros(3), _principal(x)[0], 0.0)],
    "plane": lambda x: [_Start(np.zeros(3), _principal(x)[2], 0.0)],
    "circle": lambda x: [_flat_circle(x, _principal(x)[2])[0]],
    "sphere": _start_sphere,
    "cylinder": _start_cylinder,
}
#: Dimensions in which the points must extend.
_EXTENT: dict[Shape, int] = {"line": 1, "plane": 2, "circle": 2, "sphere": 3, "cylinder": 3}


def _require_extent(shape: Shape, x: F64) -> None:
    extent = np.linalg.svd(x, compute_uv=False)
    wanted = _EXTENT[shape]
    if len(extent) < wanted or extent[wanted - 1] < SINGULAR * extent[0] or extent[0] == 0:
        where = ("", "at one place", "on one line", "in one plane")[wanted]
        raise ArithmeticError(f"the points lie {where}: no {shape} is determined")


def _unit(vector: F64) -> F64:
    out: F64 = vector / np.linalg.norm(vector)
    return out

"""The shapes: their residuals, the residuals' gradients, and their form error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from armd.arrays import F64

Shape = Literal["point", "line", "plane", "circle", "sphere", "cylinder"]


class Start(NamedTuple):
    """The start of a fit: a point, a direction, a radius, in centred and scaled coordinates."""

    point: F64
    direction: F64
    radius: float


def find_across(direction: F64) -> tuple[F64, F64]:
    """Return two unit vectors perpendicular to a direction and to each other."""
    smallest_axis = np.eye(3)[int(np.argmin(np.abs(direction)))]
    normal = np.cross(direction, smallest_axis)
    normal /= np.linalg.norm(normal)
    return normal, np.cross(direction, normal)


def move_shape(shape: Shape, start: Start, u: F64) -> Start:
    """Move the shape by its free parameters *u*, which contain no motion along itself."""
    e1, e2 = find_across(start.direction)
    d = start.direction
    match shape:
        case "point":
            return start._replace(point=start.point + u)
        case "plane":
            return Start(start.point + u[0] * d, normalise(d + u[1] * e1 + u[2] * e2), 0.0)
        case "line":
            point = start.point + u[0] * e1 + u[1] * e2
            return Start(point, normalise(d + u[2] * e1 + u[3] * e2), 0.0)
        case "sphere":
            return Start(start.point + u[:3], d, start.radius + u[3])
        case "circle":
            turned = normalise(d + u[3] * e1 + u[4] * e2)
            return Start(start.point + u[:3], turned, start.radius + u[5])
        case "cylinder":
            point = start.point + u[0] * e1 + u[1] * e2
            return Start(point, normalise(d + u[2] * e1 + u[3] * e2), start.radius + u[4])


def _away(x: F64, start: Start) -> F64:
    return x - start.point


def _radial(x: F64, start: Start) -> tuple[F64, F64]:
    """Return the distance (n,) from the axis, and unit vectors (n, 3) away from it."""
    away = _away(x, start)
    perpendicular = away - np.outer(away @ start.direction, start.direction)
    distance = np.linalg.norm(perpendicular, axis=1)
    return distance, perpendicular / np.maximum(distance, 1e-300)[:, None]


def _sphere(x: F64, start: Start) -> F64:
    out: F64 = np.linalg.norm(_away(x, start), axis=1) - start.radius
    return out[:, None]


def _sphere_gradient(x: F64, start: Start) -> F64:
    away = _away(x, start)
    out: F64 = away / np.linalg.norm(away, axis=1, keepdims=True)
    return out[:, None, :]


def _plane(x: F64, start: Start) -> F64:
    out: F64 = _away(x, start) @ start.direction
    return out[:, None]


def _line(x: F64, start: Start) -> F64:
    out: F64 = _away(x, start) @ np.stack(find_across(start.direction), axis=1)
    return out


def _circle(x: F64, start: Start) -> F64:
    return np.stack(
        [_radial(x, start)[0] - start.radius, _away(x, start) @ start.direction], axis=1
    )


def _circle_gradient(x: F64, start: Start) -> F64:
    return np.stack([_radial(x, start)[1], np.tile(start.direction, (len(x), 1))], axis=1)


def _same(rows: Callable[[Start], F64]) -> Callable[[F64, Start], F64]:
    """Return a gradient (each, 3) that is equal at every point."""
    return lambda x, start: np.tile(rows(start), (len(x), 1, 1))


def _spread(residual: F64) -> tuple[F64, float]:
    """Return signed distances, and their range as form error."""
    return residual[:, 0], float(np.ptp(residual[:, 0]))


def _around(residual: F64) -> tuple[F64, float]:
    """Return distances from a line, and the diameter of the cylinder about it that holds the
    points.
    """
    distance = np.linalg.norm(residual, axis=1)
    return distance, 2 * float(distance.max())


def _largest(residual: F64) -> tuple[F64, float]:
    distance = np.linalg.norm(residual, axis=1)
    return distance, float(distance.max())


def _ring(residual: F64) -> tuple[F64, float]:
    """Return distances from a circle, and the larger of the radial and the axial spread."""
    form = float(np.ptp(residual, axis=0).max())
    return np.linalg.norm(residual, axis=1), form


@dataclass(frozen=True)
class ShapeFit:
    """The parameter count and the functions that define the fit of a shape."""

    count: int  # free parameters
    residuals_per_point: int  # residuals of a point
    turned: bool  # has a direction
    round: bool  # has a radius
    residuals: Callable[[F64, Start], F64]  # (n, each)
    gradients: Callable[[F64, Start], F64]  # (n, each, 3), by the point
    form: Callable[[F64], tuple[F64, float]]  # distances (n,), form error


FREE: dict[Shape, ShapeFit] = {
    "point": ShapeFit(3, 3, False, False, _away, _same(lambda _: np.eye(3)), _largest),
    "line": ShapeFit(
        4,
        2,
        True,
        False,
        _line,
        _same(lambda start: np.stack(find_across(start.direction))),
        _around,
    ),
    "plane": ShapeFit(
        3, 1, True, False, _plane, _same(lambda start: start.direction[None]), _spread
    ),
    "circle": ShapeFit(6, 2, True, True, _circle, _circle_gradient, _ring),
    "sphere": ShapeFit(4, 1, False, True, _sphere, _sphere_gradient, _spread),
    "cylinder": ShapeFit(
        5, 1, True, True,
        lambda x, start: (_radial(x, start)[0] - start.radius)[:, None],
        lambda x, start: _radial(x, start)[1][:, None, :],
        _spread,
    ),
}  # fmt: skip


def normalise(vector: F64) -> F64:
    out: F64 = vector / np.linalg.norm(vector)
    return out

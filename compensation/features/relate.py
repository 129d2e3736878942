"""Distance and angle between two features, with their propagated uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from armd.arrays import F64
from armd.compensation.features.fit import Feature

#: Directions closer to parallel than this have no unique nearest point between them.
PARALLEL = 1e-9


class Relation(NamedTuple):
    value: float  # mm, or degrees
    standard_uncertainty: float | None  # in the same unit; None: not known


def compute_distance(first: Feature, second: Feature) -> Relation:
    """Compute the distance of two features in mm.

    It is measured between centres; from a centre perpendicular to a line, axis or plane; between
    two lines or axes where they are nearest; and from the second plane's point to the first plane.
    Circles and spheres count as their centres, cylinders as their axes.
    """
    return _relation(first, second, _distance, 1.0)


def compute_angle(first: Feature, second: Feature) -> Relation:
    """Compute the angle in degrees, 0 to 90, between lines, axes, planes and the planes of circles.

    Raises `ArithmeticError` for a point or a sphere, which has no direction.
    """
    for feature in (first, second):
        if feature.direction is None:
            raise ArithmeticError(f"a {feature.shape} has no direction")
    return _relation(first, second, _angle, float(np.degrees(1.0)))


def _is_plane(feature: Feature) -> bool:
    return feature.shape in ("plane", "circle")


def _distance(first: Feature, second: Feature, a: F64, b: F64) -> float:
    across = b[:3] - a[:3]
    linear = {"line", "cylinder"}
    if "plane" in (first.shape, second.shape):
        normal = a[3:6] if first.shape == "plane" else b[3:6]
        return float(abs(across @ normal) / np.linalg.norm(normal))
    if first.shape in linear and second.shape in linear:
        perpendicular = np.cross(a[3:6], b[3:6])
        if np.linalg.norm(perpendicular) > PARALLEL:
            return float(abs(across @ perpendicular) / np.linalg.norm(perpendicular))
        return _from_line(across, a[3:6])
    if first.shape in linear:
        return _from_line(across, a[3:6])
    if second.shape in linear:
        return _from_line(across, b[3:6])
    return float(np.linalg.norm(across))


def _from_line(across: F64, along: F64) -> float:
    return float(np.linalg.norm(np.cross(across, along)) / np.linalg.norm(along))


def _angle(first: Feature, second: Feature, a: F64, b: F64) -> float:
    """Return the angle in rad."""
    u, v = a[3:6], b[3:6]
    between = float(np.arctan2(np.linalg.norm(np.cross(u, v)), abs(u @ v)))
    return np.pi / 2 - between if _is_plane(first) != _is_plane(second) else between


def _relation(
    first_feature: Feature,
    second_feature: Feature,
    function: Callable[[Feature, Feature, F64, F64], float],
    unit: float,
) -> Relation:
    a, b = _values(first_feature), _values(second_feature)
    value = function(first_feature, second_feature, a, b)
    if first_feature.covariance is None or second_feature.covariance is None:
        return Relation(unit * value, None)
    variance = 0.0
    for values, covariance, first in (
        (a, first_feature.covariance, True),
        (b, second_feature.covariance, False),
    ):
        slope = np.zeros(7)
        for i in range(7):
            step = 1e-6 * max(1.0, abs(values[i])) * np.eye(7)[i]
            ahead = (a + step, b) if first else (a, b + step)
            behind = (a - step, b) if first else (a, b - step)
            change = function(first_feature, second_feature, *ahead) - function(
                first_feature, second_feature, *behind
            )
            slope[i] = change / (2 * step[i])
        variance += float(slope @ covariance @ slope)
    return Relation(unit * value, unit * float(np.sqrt(max(variance, 0.0))))


def _values(feature: Feature) -> F64:
    direction = np.zeros(3) if feature.direction is None else feature.direction
    radius = 0.0 if feature.radius_mm is None else feature.radius_mm
    return np.concatenate([feature.point_mm, direction, [radius]])

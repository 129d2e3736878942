"""Geometric features fitted to the measurements that a person picked on the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from armd.compensation.features.fit import SHAPES, Feature, fit
from armd.compensation.features.relate import Relation, compute_angle, compute_distance
from armd.errors import ArmdError, BadInput

MeasuredById = Mapping[str, Mapping[str, Any]]
"""As published, by the id that the page has of each."""


def fit_feature(measured: MeasuredById, query: Mapping[str, str]) -> dict[str, Any]:
    """Fit the feature of *query*, such as `of=plane:ID,ID,…`.

    With `and=…`, a second feature, return the distance and the angle of both. Raises `BadInput` for
    an invalid feature, and `ArmdError` for points that determine none.
    """
    first = _fitted(measured, query.get("of", ""))
    if "and" not in query:
        return first.as_json()
    second = _fitted(measured, query["and"])
    return {
        "distance": _related(compute_distance, first, second),
        "angle": _related(compute_angle, first, second),
    }


def _fitted(measured: MeasuredById, text: str) -> Feature:
    name, _, ids = text.partition(":")
    shape = next((candidate for candidate in SHAPES if candidate == name), None)
    if shape is None:
        raise BadInput("the page", "feature", repr(name[:40]), f"one of {', '.join(SHAPES)}")
    chosen = [measured.get(measurement_id) for measurement_id in dict.fromkeys(ids.split(","))]
    usable = [m for m in chosen if m is not None and m["position_mm"] is not None]
    if len(usable) != len(chosen):
        problem = f"{len(chosen) - len(usable)} measurements without a position, or not kept"
        raise BadInput("the page", "feature", problem, "measurements of the list, with a position")
    points = np.array([m["position_mm"] for m in usable], dtype=float)
    rows = [m.get("covariance_mm2") for m in usable]
    covariances = None if None in rows else np.array([_unpack_covariance(row) for row in rows])
    try:
        return fit(shape, points, covariances)
    except ArithmeticError as error:
        raise ArmdError(f"no {shape}: {error}") from error


def _unpack_covariance(row: Any) -> list[list[float]]:
    xx, xy, xz, yy, yz, zz = row
    return [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]


def _related(
    relate: Callable[[Feature, Feature], Relation], first: Feature, second: Feature
) -> dict[str, float | None] | None:
    """Return the relation of two features; None if there is none: a point has no direction."""
    try:
        relation = relate(first, second)
    except ArithmeticError:
        return None
    return {"value": relation.value, "standard_uncertainty": relation.standard_uncertainty}

"""Geometric features through the measurements that a person picked on the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from armd.compensation.features.fit import SHAPES, Feature, fit
from armd.compensation.features.relate import Relation, angle, distance
from armd.errors import ArmdError, BadInput

MeasuredById = Mapping[str, Mapping[str, Any]]
"""As published, by the id that the page has of each."""


def feature(measured: MeasuredById, query: Mapping[str, str]) -> dict[str, Any]:
    """What *query* asks for: `of=plane:ID,ID,…`; with `and=…` likewise, their distance and angle.

    Raises `BadInput` for what is no feature, `ArmdError` for points that determine none.
    """
    one = _fitted(measured, query.get("of", ""))
    if "and" not in query:
        return one.as_json()
    other = _fitted(measured, query["and"])
    return {"distance": _related(distance, one, other), "angle": _related(angle, one, other)}


def _fitted(measured: MeasuredById, text: str) -> Feature:
    name, _, ids = text.partition(":")
    shape = next((known for known in SHAPES if known == name), None)
    if shape is None:
        raise BadInput("the page", "feature", repr(name[:40]), f"one of {', '.join(SHAPES)}")
    chosen = [measured.get(one) for one in dict.fromkeys(ids.split(","))]
    known = [one for one in chosen if one is not None and one["position_mm"] is not None]
    if len(known) != len(chosen):
        found = f"{len(chosen) - len(known)} measurements without a position, or not kept"
        raise BadInput("the page", "feature", found, "measurements of the list, with a position")
    points = np.array([one["position_mm"] for one in known], dtype=float)
    covariances = [one.get("covariance_mm2") for one in known]
    told = None if None in covariances else np.array([_square(row) for row in covariances])
    try:
        return fit(shape, points, told)
    except ArithmeticError as error:
        raise ArmdError(f"no {shape}: {error}") from error


def _square(row: Any) -> list[list[float]]:
    xx, xy, xz, yy, yz, zz = row
    return [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]


def _related(
    relate: Callable[[Feature, Feature], Relation], one: Feature, other: Feature
) -> dict[str, float | None] | None:
    """None where the two have no such relation: a point has no direction."""
    try:
        found = relate(one, other)
    except ArithmeticError:
        return None
    return {"value": found.value, "standard_uncertainty": found.standard_uncertainty}

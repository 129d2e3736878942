"""How far residuals over a variable stand out of noise, whatever the number of its bins.

Shapes of more and more freedom are tried: flat, a straight line, what the variable's kind suggests
(an angle's first harmonics, a rate's amount and sign, a step in time), every bin by itself. Each
gives the χ² of what it explains by the drawn sets' covariance. The one counts of which χ² − 2 k is
the largest, k being its freedom (Akaike, IEEE Trans. Autom. Control 19, 1974), so that many bins
have no advantage over few.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import (
    DEPENDENT_SHARE,
    LEAST_POSITIVE,
    LEAST_VARIANCE_SHARE,
    SEARCHED_VARIABLES,
    SHAPES_BY_KIND,
)
from armd.compensation.diagnose.predictive.bins import Bins


@dataclass(frozen=True)
class Strength:
    """χ² − 2 k of the best shape, and of a flat one."""

    best: float
    flat: float

    @property
    def noise_units(self) -> float:
        """Root of what stands out; 0 where noise explains it."""
        return float(np.sqrt(max(self.best, 0.0)))


def features(bins: Bins) -> F64:
    """(k, m) functions of a variable at the rests in its bins' order; the first is flat."""
    values = bins.values
    flat = np.ones((len(bins.order), 1))
    if values is None:
        return flat
    if bins.kind == "rate":
        x = values / max(float(np.abs(values).max()), LEAST_POSITIVE)
        return _across(np.column_stack([flat, x, np.abs(x), np.sign(x)]))
    x = _scaled(values)
    if bins.kind == "angle":
        turn = np.radians(values)
        harmonics = [wave(order * turn) for order in (1, 2) for wave in (np.cos, np.sin)]
        return _across(np.column_stack([flat, *harmonics, x]))
    return _across(np.column_stack([flat, x, x**2, x**3]))


def _across(columns: F64) -> F64:
    """Each of *columns* without what those before it have, of mean square 1; one that has nothing
    of its own is 0."""
    length = np.linalg.norm(columns, axis=0)
    basis, upper = np.linalg.qr(columns)
    own = np.abs(np.diag(upper)) > DEPENDENT_SHARE * length
    apart: F64 = basis * own * np.sqrt(len(columns))
    return apart


def shapes(bins: Bins, count: int) -> list[I64]:
    """Places of each shape in the vector of a variable's features, *count*, and then its bins."""
    first = SHAPES_BY_KIND.get(bins.kind, ()) if bins.values is not None else ()
    every = count + np.arange(len(bins.starts))
    return [*(np.arange(k) for k in (1, *first)), every]


@dataclass(frozen=True)
class Scatter:
    """How sums (m,) of drawn sets scatter."""

    covariance: F64  # (m, m); or variances (m,) of sums taken as independent
    unabsorbed: F64  # (m,) variances if nothing absorbed any of them
    draws: int  # that have told the covariance

    def of(self, at: I64) -> Scatter:
        """Of some of the sums."""
        return Scatter(self.covariance[np.ix_(at, at)], self.unabsorbed[at], self.draws)

    def along(self, shape: F64) -> Scatter:
        """Of sums (k,) of these sums that are apart from each other, by rows (k, m)."""
        covariance = shape @ self.covariance @ shape.T
        return Scatter(covariance, shape**2 @ self.unabsorbed, self.draws)


def strength(bins: Bins, values: F64, scatter: Scatter, joint: float = -np.inf) -> Strength:
    """Of a variable's *values* (m + B,); *joint*: what it explains with another of its kind."""
    covariance = scatter.covariance
    if covariance.ndim == 1:
        known = covariance > LEAST_VARIANCE_SHARE * scatter.unabsorbed
        square = np.where(known, values**2 / np.maximum(covariance, LEAST_POSITIVE), 2.0)
        flat = float(values.sum()) ** 2 / max(float(covariance.sum()), LEAST_POSITIVE) - 2.0
        return Strength(max(float(square.sum()) - 2.0 * len(values), flat), flat)
    count = len(values) - len(bins.starts)
    tried = [beyond(values[at], scatter.of(at)) for at in shapes(bins, count)]
    if bins.kind == "time":
        every = np.arange(count, len(values))
        tried.append(_step(values[every], scatter.of(every)))
    if bins.kind == "name":
        tried.append(_single(values, scatter, count))
    return Strength(max(joint, *tried), tried[0])


def beyond(values: F64, scatter: Scatter) -> float:
    """χ² − 2 k of *values* (m,), by a covariance that draws have told (Hotelling)."""
    scale = np.sqrt(np.maximum(scatter.unabsorbed, LEAST_POSITIVE))
    root, turned = np.linalg.eigh(scatter.covariance / np.outer(scale, scale))
    kept = root > LEAST_VARIANCE_SHARE
    freedom = int(kept.sum())
    along = turned[:, kept].T @ (values / scale)
    square = float((along**2 / root[kept]).sum())
    return square * (scatter.draws - freedom - 1) / scatter.draws - 2.0 * freedom


def lines_together(bins: Sequence[Bins], rests: int) -> F64:
    """(n, 1 + S) flat, and a straight line over each of several variables."""
    lines = np.zeros((rests, 1 + len(bins)))
    lines[:, 0] = 1.0
    for i, one in enumerate(bins, 1):
        if one.values is not None:
            lines[one.order, i] = _scaled(one.values)
    lines[:, 1:] -= lines[:, 1:].mean(axis=0)
    return lines


def of_pairs(bins: Sequence[Bins], values: F64, scatter: Scatter) -> dict[str, float]:
    """χ² − 2 k of straight lines (1 + S,) over two variables together, for the one of each pair
    that explains more by itself: a difference of two temperatures is explained by neither."""
    alone = [_part(values, scatter, [0, i]) for i in range(1, len(values))]
    found: dict[str, float] = {}
    for i, j in combinations(range(len(bins)), 2):
        name = bins[i if alone[i] >= alone[j] else j].variable
        both = _part(values, scatter, [0, i + 1, j + 1]) - 2.0 * SEARCHED_VARIABLES
        found[name] = max(found.get(name, -np.inf), both)
    return found


def _part(values: F64, scatter: Scatter, places: list[int]) -> float:
    return beyond(values[places], scatter.of(np.array(places)))


def _step(sums: F64, scatter: Scatter) -> float:
    """χ² − 2 k of the best step between two of the bins."""
    found = []
    for end in range(1, len(sums)):
        sides = np.zeros((2, len(sums)))
        sides[0, :end] = sides[1, end:] = 1.0
        found.append(beyond(sides @ sums, scatter.along(sides)))
    return max(found, default=-np.inf) - 2.0 * float(np.log(max(len(sums), 1)))


def _single(values: F64, scatter: Scatter, first: int) -> float:
    """χ² − 2 k of the one bin that stands out most by itself: a target that was loosened."""
    variance = np.diag(scatter.covariance)[first:]
    known = variance > LEAST_VARIANCE_SHARE * scatter.unabsorbed[first:]
    square = np.where(known, values[first:] ** 2 / np.maximum(variance, LEAST_POSITIVE), 0.0)
    return float(square.max()) - 2.0 - 2.0 * float(np.log(len(square)))


def _scaled(values: F64) -> F64:
    """To −1 … 1."""
    scaled: F64 = 2.0 * (values - values.min()) / max(float(np.ptp(values)), LEAST_POSITIVE) - 1.0
    return scaled

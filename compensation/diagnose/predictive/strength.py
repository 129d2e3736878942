"""The strength of residuals over a variable beyond noise, whatever the number of its bins.

Shapes of increasing freedom are tried: flat, a straight line, those that suit the variable's kind
(an angle's harmonics and waves, a rate's amount and sign, a step in time), every bin by itself. The
strength of a shape is twice the log likelihood ratio of the model with and without it, less k log n
with k its freedom (Schwarz, Annals of Statistics 6, 1978). So many bins have no advantage over few.
Residuals that remain beside a shape count as noise, too, where they exceed the estimated noise: a
large error projects by chance on any set of many bins.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import (
    DEPENDENT_SHARE,
    LEAST_POSITIVE,
    LEAST_VARIANCE_SHARE,
    SHAPES_BY_KIND,
)
from armd.compensation.diagnose.predictive.bins import Bins


@dataclass(frozen=True)
class Misfit:
    """The misfit of a model over all residuals."""

    chi_squared: float  # χ² by the estimated noise
    freedom: float  # its expected value for noise alone

    def compute_gain(self, explained: F64 | float) -> F64:
        """Return twice the log likelihood gained by a curve that has *explained* so much of χ².

        It is by the estimated noise, or by the remaining residuals where these are larger.
        """
        gain: F64 = self._compute_cost(self.chi_squared) - self._compute_cost(
            self.chi_squared - explained
        )
        return gain

    def _compute_cost(self, chi_squared: F64 | float) -> F64:
        over = np.maximum(chi_squared / self.freedom, 1.0)
        cost: F64 = self.freedom * np.log(over) + chi_squared / over
        return cost

    def compute_price(self, unknowns: I64 | int, searched: int = 1) -> F64:
        """Return the penalty for so many unknowns, and for the best of *searched* shapes."""
        price: F64 = unknowns * np.log(self.freedom) + 2.0 * np.log(max(searched, 1))
        return price


@dataclass(frozen=True)
class Strength:
    """The strength of the best shape, and of a flat one."""

    best: float
    flat: float

    @property
    def noise_units(self) -> float:
        """The root of the best strength; 0 where noise explains it."""
        return float(np.sqrt(max(self.best, 0.0)))


def make_features(bins: Bins) -> F64:
    """Return functions (k, m) of a variable at the rests in its bins' order; the first is flat."""
    values = bins.values
    flat = np.ones((len(bins.order), 1))
    if values is None:
        return flat
    if bins.kind == "rate":
        x = values / max(float(np.abs(values).max()), LEAST_POSITIVE)
        return _orthogonalise(np.column_stack([flat, x, np.abs(x), np.sign(x)]))
    x = _scale_to_unit(values)
    if bins.kind == "angle":
        turn = np.radians(values)
        harmonics = [wave(order * turn) for order in (1, 2) for wave in (np.cos, np.sin)]
        return _orthogonalise(np.column_stack([flat, *harmonics, x]))
    return _orthogonalise(np.column_stack([flat, x, x**2, x**3]))


def _orthogonalise(columns: F64) -> F64:
    """Orthogonalise each of *columns* to those before it, and scale it to a mean square of 1.

    A column that depends on those before it becomes 0.
    """
    length = np.linalg.norm(columns, axis=0)
    basis, upper = np.linalg.qr(columns)
    is_independent = np.abs(np.diag(upper)) > DEPENDENT_SHARE * length
    orthogonal: F64 = basis * is_independent * np.sqrt(len(columns))
    return orthogonal


def list_shapes(bins: Bins, count: int) -> list[I64]:
    """List each shape's indices in a vector of *count* features and then bins."""
    first = SHAPES_BY_KIND.get(bins.kind, ()) if bins.values is not None else ()
    every = count + np.arange(len(bins.starts))
    return [*(np.arange(k) for k in (1, *first)), every]


@dataclass(frozen=True)
class Scatter:
    """The scatter of sums (…, m) of noise."""

    covariance: F64  # (…, m, m); or variances (…, m) of sums taken as independent
    unabsorbed: F64  # (…, m) variances if nothing absorbed any of them

    @property
    def is_independent(self) -> bool:
        """Whether the sums are taken as independent."""
        return self.covariance.ndim == self.unabsorbed.ndim

    @classmethod
    def stack(cls, scatters: Iterable[Scatter]) -> Scatter:
        """Stack the scatters of several vectors of sums."""
        pairs = [(scatter.covariance, scatter.unabsorbed) for scatter in scatters]
        return cls(*map(np.array, zip(*pairs, strict=True)))

    def select(self, places: I64) -> Scatter:
        """Return the scatter of some of the sums, or of several choices (…, k) among them."""
        rows, columns = places[..., :, None], places[..., None, :]
        return Scatter(self.covariance[..., rows, columns], self.unabsorbed[..., places])

    def combine(self, shape: F64) -> Scatter:
        """Return the scatter of sums (s, k) of these sums, by rows (s, k, m).

        The rows must have no sum in common.
        """
        covariance = shape @ self.covariance[..., None, :, :] @ np.swapaxes(shape, -1, -2)
        return Scatter(covariance, (shape**2 @ self.unabsorbed[..., None, :, None])[..., 0])


def compute_strengths(
    bins: Bins, values: F64, scatter: Scatter, misfit: Misfit, joint: F64
) -> list[Strength]:
    """Return the strength of each component from a variable's *values* (K, m + B).

    *joint* (K,): scores of the variable together with another of its kind.
    """
    if scatter.is_independent:
        return _make_strengths(_score_many_bins(values, scatter, misfit))
    count = values.shape[1] - len(bins.starts)
    tried = [
        score_shapes(values[:, places], scatter.select(places), misfit)
        for places in list_shapes(bins, count)
    ]
    every: I64 = np.arange(count, values.shape[1])
    if bins.kind == "time":
        tried.append(_score_best_step(values[:, every], scatter.select(every), misfit))
    if bins.kind == "name":
        tried.append(_score_largest_bin(values[:, every], scatter.select(every), misfit))
    return _make_strengths([*tried, joint])


def _make_strengths(tried: Sequence[F64]) -> list[Strength]:
    """Make strengths from the scores (K,) of each shape, the first of which is flat."""
    best = np.max(tried, axis=0)
    return [Strength(*pair) for pair in zip(best.tolist(), tried[0].tolist(), strict=True)]


def _score_many_bins(values: F64, scatter: Scatter, misfit: Misfit) -> tuple[F64, F64]:
    """Score (K,) a flat shape and every bin, for more bins than have a common covariance."""
    is_clear = scatter.covariance > LEAST_VARIANCE_SHARE * scatter.unabsorbed
    total = np.maximum(scatter.covariance.sum(axis=1), LEAST_POSITIVE)
    flat = misfit.compute_gain(values.sum(axis=1) ** 2 / total) - misfit.compute_price(1)
    variance = np.where(is_clear, scatter.covariance, np.inf)
    every = misfit.compute_gain((values**2 / variance).sum(axis=1))
    return flat, every - misfit.compute_price(is_clear.sum(axis=1))


def score_shapes(values: F64, scatter: Scatter, misfit: Misfit, searched: int = 1) -> F64:
    """Return the score (…,) of each shape with *values* (…, m), the best of so many *searched*."""
    scale = np.sqrt(np.maximum(scatter.unabsorbed, LEAST_POSITIVE))
    root, turned = np.linalg.eigh(scatter.covariance / (scale[..., :, None] * scale[..., None, :]))
    is_clear = root > LEAST_VARIANCE_SHARE
    along = np.einsum("...ij,...i->...j", turned, values / scale)
    explained = np.where(is_clear, along**2 / np.where(is_clear, root, 1.0), 0.0).sum(axis=-1)
    return misfit.compute_gain(explained) - misfit.compute_price(is_clear.sum(axis=-1), searched)


def make_lines(variables: Sequence[Bins], rests: int) -> F64:
    """Return (n, 1 + S): a constant, and a straight line over each of several variables."""
    lines = np.zeros((rests, 1 + len(variables)))
    lines[:, 0] = 1.0
    for i, bins in enumerate(variables, 1):
        if bins.values is not None:
            lines[bins.order, i] = _scale_to_unit(bins.values)
    lines[:, 1:] -= lines[:, 1:].mean(axis=0)
    return lines


def compute_strengths_of_pairs(values: F64, scatter: Scatter, misfit: Misfit) -> F64:
    """Return the scores (S,) of straight lines over two variables together, from sums (1 + S,).

    A pair's score belongs to the one of its variables that explains more by itself. A difference of
    two temperatures is explained by neither alone.
    """
    count = len(values) - 1

    def score_lines(lines: I64, searched: int) -> F64:
        places = np.insert(1 + lines, 0, 0, axis=1)  # together with a constant
        return score_shapes(values[places], scatter.select(places), misfit, searched)

    by_itself = score_lines(np.arange(count)[:, None], 1)
    first, second = np.triu_indices(count, 1)
    explains_more = np.where(by_itself[first] >= by_itself[second], first, second)
    strengths = np.full(count, -np.inf)
    together = score_lines(np.stack([first, second], axis=1), count - 1)
    np.maximum.at(strengths, explains_more, together)
    return strengths


def _score_best_step(sums: F64, scatter: Scatter, misfit: Misfit) -> F64:
    """Score (K,) the best step between two of the bins."""
    count = sums.shape[1]
    if count < 2:
        return np.full(len(sums), -np.inf)
    before = np.tri(count - 1, count)
    sides = np.stack([before, 1.0 - before], axis=1)
    values = np.einsum("sib,kb->ksi", sides, sums)
    best: F64 = score_shapes(values, scatter.combine(sides), misfit, count - 1).max(axis=1)
    return best


def _score_largest_bin(sums: F64, scatter: Scatter, misfit: Misfit) -> F64:
    """Score (K,) the one bin that stands out most by itself, such as a target that was loosened."""
    variance = np.diagonal(scatter.covariance, axis1=1, axis2=2)
    is_clear = variance > LEAST_VARIANCE_SHARE * scatter.unabsorbed
    explained = np.where(is_clear, sums**2 / np.maximum(variance, LEAST_POSITIVE), 0.0)
    return misfit.compute_gain(explained.max(axis=1)) - misfit.compute_price(1, sums.shape[1])


def _scale_to_unit(values: F64) -> F64:
    """Scale values to −1 … 1."""
    scaled: F64 = 2.0 * (values - values.min()) / max(float(np.ptp(values)), LEAST_POSITIVE) - 1.0
    return scaled

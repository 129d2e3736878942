"""The covariance of every point, from the uncertainty of identification, encoders and sensors.

When a temperature arrives, all of it is folded into one low-rank factor L over the parameters (and
the pose terms' coefficients). A sample costs its Jacobian J and the product J·L, in `points`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration, list_sensors
from armd.compensation.model.terms import Term
from armd.compiled.jit import jit

#: The share of the variance that the low-rank factor may omit.
NEGLECTED = 1e-14


class Parts(NamedTuple):
    """The parts from which the covariance is assembled, in mm at the tip.

    Its n rows are the uncertain parameters and coefficients of pose terms.
    """

    identified: F64  # (K, K) covariance of the identified quantities, mm²
    row: I64  # (K,) the row in which a quantity acts
    scaled_by: I64  # (K,) the term whose slow factors scale it, or NO_TERM
    encoder: F64  # (n,) variances that the encoders add, mm²
    warm: I64  # (W,) slow and pose terms that depend on a temperature
    warm_row: I64  # (W,) the row in which such a term acts
    warm_amount: F64  # (W,) effect of a unit of its slow factors
    scale: F64  # (n,) approximate mm at the tip per unit of each row


class Scratch(NamedTuple):
    """Work arrays for one factor."""

    matrix: F64  # (n, n)
    columns: F64  # (n, n) of the factor, one per row
    remaining: F64  # (n,)


NO_TERM = -1


class Uncertainty:
    """The uncertainty of one model; empty if its calibration states none."""

    def __init__(
        self, arm: Arm, calibration: Calibration | None, slow: Sequence[Term], pose: Sequence[Term]
    ) -> None:
        #: mm², along each axis, of noise without a Jacobian; NaN if nothing is known
        self.floor = np.nan
        self.temperature_c = 0.0  # standard deviation of a sensor
        if calibration is not None:
            noise = calibration.noise
            self.temperature_c = noise.temperature_c
            has_noise = noise.reading_mm or noise.temperature_c or any(noise.encoder_rad)
            if has_noise or calibration.covariance_of:
                # Repeatability is the noise that the encoders do not explain (`estimate.noise`
                # separates the two); the encoders' share comes through their Jacobian.
                self.floor = noise.reading_mm**2
        #: (n,) the numbers of the factor's rows: parameters, then pose terms; and their known parts
        self.rows, self.parts = _parts(arm, calibration, slow, pose)
        n = len(self.rows)
        #: (n, r) L L' is the covariance of parameters and pose terms' coefficients
        self.factor = np.zeros((n, 0))
        self._work = Scratch(np.zeros((n, n)), np.zeros((n, n)), np.zeros(n))
        self._numbers = np.zeros(n * n)  # of the factor, whose rank differs from fold to fold

    def fold(self, values: F64, changes: F64) -> None:
        """Fold for the slow factors' values (L+T,); `factor` is valid until the next call.

        *changes* (S, L+T): the effect of one standard deviation of each sensor on them.
        """
        rank = _factor(values, changes, self.parts, self._work, self._numbers)
        n = len(self.factor)
        self.factor = self._numbers[: n * rank].reshape(n, rank)


def _parts(
    arm: Arm, calibration: Calibration | None, slow: Sequence[Term], pose: Sequence[Term]
) -> tuple[I64, Parts]:
    layout = arm.layout
    names = layout.names
    terms = [*slow, *pose]
    of_term = np.array(layout.indices(term.parameter for term in terms), np.int64)
    pose_rows = np.arange(len(names), len(names) + len(pose))
    acts_in = np.concatenate([of_term[: len(slow)], pose_rows])  # as numbered in `rows`

    # The scale in which the low-rank factor is judged: an angle moves the tip by the arm's reach.
    scale = np.where(layout.are_lengths, 1.0, arm.reach_mm or 1.0)
    scale = np.concatenate([scale, scale[of_term[len(slow) :]]])

    covariance_of = [] if calibration is None else calibration.covariance_of
    count = len(covariance_of)
    row, scaled_by = np.zeros(count, np.int64), np.full(count, NO_TERM, np.int64)
    identified, encoder = np.zeros((count, count)), np.zeros(len(scale))
    warm = np.zeros(0, np.int64)
    if calibration is not None:
        place = {id(term): t for t, term in enumerate(terms)}
        for i, name in enumerate(covariance_of):
            if name in layout:
                row[i] = layout.index(name)
                continue
            scaled_by[i] = place[id(calibration.terms[int(name.removeprefix("term "))])]
            row[i] = acts_in[scaled_by[i]]
        variances, directions = np.linalg.eigh(
            np.array(calibration.covariance, dtype=float).reshape(count, count)
        )
        root = scale[row, None] * directions * np.sqrt(np.maximum(variances, 0.0))
        identified = root @ root.T
        deviation = np.array(calibration.noise.encoder_rad)
        angles = np.arange(len(names))[layout.angles][: len(deviation)]
        encoder[angles] = (scale[angles] * deviation) ** 2
        if calibration.noise.temperature_c:
            warm = np.flatnonzero([bool(list_sensors([term])) for term in terms])
    rows = np.unique(np.concatenate([row, np.flatnonzero(encoder), acts_in[warm]]))
    return rows, Parts(
        identified=identified,
        row=np.searchsorted(rows, row),
        scaled_by=scaled_by,
        encoder=encoder[rows],
        warm=warm,
        warm_row=np.searchsorted(rows, acts_in[warm]),
        warm_amount=np.array([terms[t].coefficient for t in warm]) * scale[acts_in[warm]],
        scale=scale[rows],
    )


@jit
def _factor(values: F64, changes: F64, parts: Parts, work: Scratch, numbers: F64) -> int:
    """Write the factor (n, r) into the first n · r of *numbers*; return r."""
    matrix, columns, scratch = work
    assemble(values, changes, parts, matrix, scratch)
    rank = factorise_pivoted(matrix, scratch, columns)
    for i in range(len(matrix)):
        for r in range(rank):
            numbers[i * rank + r] = columns[r, i] / parts.scale[i]
    return rank


@jit
def assemble(values: F64, changes: F64, parts: Parts, matrix: F64, scratch: F64) -> None:
    """Assemble the covariance of the rows in *matrix* (n, n), mm²."""
    identified, row, scaled_by, encoder, warm, warm_row, warm_amount, _ = parts
    n = len(matrix)
    for i in range(n):
        for j in range(n):
            matrix[i, j] = 0.0
        matrix[i, i] = encoder[i]
    for a in range(len(row)):
        by = 1.0 if scaled_by[a] == NO_TERM else values[scaled_by[a]]
        for b in range(len(row)):
            factor = by if scaled_by[b] == NO_TERM else by * values[scaled_by[b]]
            matrix[row[a], row[b]] += factor * identified[a, b]
    for s in range(len(changes)):
        for i in range(n):
            scratch[i] = 0.0
        for w in range(len(warm)):
            scratch[warm_row[w]] += warm_amount[w] * changes[s, warm[w]]
        for i in range(n):
            if scratch[i] != 0.0:
                for j in range(n):
                    matrix[i, j] += scratch[i] * scratch[j]


@jit
def factorise_pivoted(matrix: F64, remaining: F64, columns: F64) -> int:
    """Compute columns of L, one per row of *columns*, with L·L' equal to *matrix* (n, n) but for a
    rest.

    The rest is positive semidefinite, and its trace is at most NEGLECTED of the matrix's. Returns
    the number of columns, at most the rank. *remaining* (n,) is scratch.
    """
    n = len(matrix)
    total = 0.0
    for i in range(n):
        remaining[i] = matrix[i, i]
        total += remaining[i]
    rank = 0
    while rank < n:
        trace, pivot = 0.0, 0
        for i in range(n):
            trace += remaining[i]
            if remaining[i] > remaining[pivot]:
                pivot = i
        if trace <= NEGLECTED * total:  # never true with a NaN, which then reaches the result
            break
        column, root = columns[rank], math.sqrt(remaining[pivot])
        for i in range(n):
            column[i] = matrix[pivot, i]
        for r in range(rank):
            along = columns[r, pivot]
            for i in range(n):
                column[i] -= along * columns[r, i]
        for i in range(n):
            column[i] /= root
            remaining[i] -= column[i] * column[i]
            if remaining[i] < 0.0:
                remaining[i] = 0.0
        remaining[pivot] = 0.0
        rank += 1
    return rank

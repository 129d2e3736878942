"""How large a fault is in units of the noise, clear of all that may absorb it.

The oracle of the cases: least squares of the fault's displacement on every identified constant and
every placement's pose; what remains, over the noise. Sessions from before the fault are rows
without displacement: under a calibration made of them constants are free only as far as they say.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from outsider.chain import F64, Alteration, by_angles, by_constants, posture
from outsider.measured import Machine, Readings

#: Directions weaker than this, of columns of length 1, hold nothing (a beam's turn about itself).
WEAKEST = 1e-8


class Seen:
    """The columns that absorb, of some readings of a machine; worked out once."""

    def __init__(self, machine: Machine, readings: Readings, seat_mm: F64 | float) -> None:
        """*seat_mm*: the scatter of a point along each axis, of each reading (n,) or of all."""
        self.machine, self.readings = machine, readings
        table, q, warm = machine.built, readings.q, readings.warm
        jacobian = by_angles(posture(table, q, warm))
        noise = machine.encoder_rad**2 * jacobian @ np.swapaxes(jacobian, 1, 2)
        scatter = np.broadcast_to(np.square(seat_mm), len(q))[:, None, None] * np.eye(3)
        self._whiten = np.linalg.inv(np.linalg.cholesky(noise + scatter))
        self._poses = [
            (rows, _basis(self._white(_pose(readings.lever[rows]), rows)))
            for rows in map(np.flatnonzero, readings.placement == _numbers(readings)[:, None])
        ]
        every = np.arange(len(q))
        constants = self._white(by_constants(table, q, warm), every)
        self._constants = _basis(self._clear_of_poses(constants))

    def _white(self, columns: F64, rows: F64) -> F64:
        """(rows, 3, m) mm → (3 rows, m) in noise units."""
        return (self._whiten[rows] @ columns).reshape(3 * len(rows), -1)

    def _clear_of_poses(self, columns: F64) -> F64:
        clear = columns.reshape(-1, 3, columns.shape[1]).copy()
        for rows, basis in self._poses:
            part = clear[rows].reshape(3 * len(rows), -1)
            clear[rows] = (part - basis @ (basis.T @ part)).reshape(len(rows), 3, -1)
        return clear.reshape(columns.shape)

    def displacement(self, alter: Alteration) -> F64:
        """(n, 3) mm: what a healthy model misses the touched points by."""
        machine, readings = self.machine, self.readings
        shown = posture(
            machine.built, readings.q + alter.encoder, readings.warm + alter.sensor
        )  # fmt: skip
        true = posture(machine.built, readings.q, readings.warm, alter)
        missed: F64 = shown.tip - true.tip + alter.target
        return missed

    def noise_units(self, alter: Alteration, beside: Sequence[Alteration] = ()) -> float:
        """The norm of what no constant and no pose absorbs; nor others *beside* it, of any size."""
        rest = self._clear(alter)
        if beside:
            others = np.stack([self._clear(other) for other in beside], axis=1)
            rest = rest - others @ np.linalg.lstsq(others, rest, rcond=None)[0]
        return float(np.linalg.norm(rest))

    def _clear(self, alter: Alteration) -> F64:
        moved = self.displacement(alter)[..., None]
        white = self._clear_of_poses(self._white(moved, np.arange(len(moved))))
        clear: F64 = (white - self._constants @ (self._constants.T @ white))[:, 0]
        return clear


def _numbers(readings: Readings) -> F64:
    numbers: F64 = np.unique(readings.placement)
    return numbers


def _pose(lever: F64) -> F64:
    """(n, 3, 6) what shifts and turns of a placement do to its points."""
    x, y, z = lever.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = [
        [one, zero, zero, zero, z, -y],
        [zero, one, zero, -z, zero, x],
        [zero, zero, one, y, -x, zero],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _basis(columns: F64) -> F64:
    """Orthonormal, of all that the columns hold."""
    length = np.linalg.norm(columns, axis=0)
    left, values, _ = np.linalg.svd(columns / np.maximum(length, 1e-30), full_matrices=False)
    basis: F64 = left[:, values > WEAKEST * values[0]]
    return basis

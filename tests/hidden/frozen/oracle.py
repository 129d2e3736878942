"""What a fit that is told the causes reaches: noise units of each cause, and its held-out error.

All of it is linear least squares around the truth, on the noise that the readings have: unknowns
are the arm's constants, the pose of each placement, and the amplitude of each planted cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
BEFORE, DIAGNOSED, FURTHER = 0, 1, 2
#: Of what a constant moves, what the poses leave; below it there is no direction to fit. Columns
#: are differences of positions, good to 1e-10: what is left of less is the processor's rounding,
#: and some 50 mm of such a constant would be one noise unit.
WEAKEST = 1e-5


@dataclass(frozen=True)
class Problem:
    """n readings, in mm and the base frame."""

    constants: F64  # (n, 3, m) how each constant moves the tip
    effects: Sequence[F64]  # (n, 3) what a model without it errs by, of each planted cause
    remainder: F64  # (n, 3) what a model that knows everything errs by
    lever: F64  # (n, 3) from the placement's origin to the target
    placement: I64  # (n,) a number for each, over all sessions
    part: I64  # (n,) BEFORE, DIAGNOSED or FURTHER
    sigma_mm: F64  # (n,) noise of each axis

    def noise_units(self) -> list[float]:
        """The norm of each effect, clear of constants, poses and the other effects."""
        rows = self.part != FURTHER
        white, whole = self._white([*self.effects], rows)
        constants = _basis(*self._white_constants(rows))
        clear = white - constants @ (constants.T @ white)
        units = []
        for i in range(clear.shape[1]):
            others = _basis(np.delete(clear, i, axis=1), np.delete(whole, i))
            remains = clear[:, i] - others @ (others.T @ clear[:, i])
            units.append(float(np.linalg.norm(remains)))
        return units

    def oracle_um(self) -> float:
        """3-D RMS on the further sessions of a fit to all others that is told the causes."""
        rows = self.part != FURTHER
        both = self._white_constants(rows), self._white([*self.effects], rows)
        columns, whole = (np.concatenate(one, axis=-1) for one in zip(*both, strict=True))
        wanted = self._white([self.remainder], rows)[0][:, 0]
        left, values, right = _directions(columns, whole)
        found = right.T @ ((left.T @ wanted) / values) / whole
        m = self.constants.shape[2]
        predicted = self.constants @ found[:m]
        for effect, amplitude in zip(self.effects, found[m:], strict=True):
            predicted = predicted + amplitude * effect
        missed = (self.remainder - predicted)[~rows]
        sigma = np.ones(len(missed))
        clear = _clear_of_poses(
            missed.reshape(-1, 1), self.lever[~rows], self.placement[~rows], sigma
        )
        return 1e3 * float(np.sqrt((clear**2).sum() / len(missed)))

    def noise_um(self) -> float:
        """3-D RMS of the noise alone on the further sessions."""
        noise = self.remainder[self.part == FURTHER]
        return 1e3 * float(np.sqrt((noise**2).sum() / len(noise)))

    def unexplained_mm(self) -> float:
        """Standard deviation of an axis of what constants and poses leave of the remainder, all
        parts but FURTHER, for sigmas of 1 mm."""
        rows = self.part != FURTHER
        left, _ = self._white([self.remainder], rows)
        constants = _basis(*self._white_constants(rows))
        clear = left - constants @ (constants.T @ left)
        unknowns = constants.shape[1] + _count_poses(self.lever[rows], self.placement[rows])
        return float(np.sqrt((clear**2).sum() / (len(clear) - unknowns)))

    def _white_constants(self, rows: NDArray[np.bool_]) -> tuple[F64, F64]:
        return self._white(list(np.moveaxis(self.constants, 2, 0)), rows)

    def _white(self, displacements: list[F64], rows: NDArray[np.bool_]) -> tuple[F64, F64]:
        """(3 rows, columns) in noise units, clear of the placements' poses; and the length of each
        column before it was clear of them, 1 for one of zeros."""
        sigma = self.sigma_mm[rows]
        if not displacements:
            return np.empty((3 * len(sigma), 0)), np.empty(0)
        stacked = np.stack([one[rows] / sigma[:, None] for one in displacements], axis=2)
        flat = stacked.reshape(3 * len(sigma), -1)
        clear = _clear_of_poses(flat, self.lever[rows], self.placement[rows], sigma)
        return clear, _lengths(flat)


def _clear_of_poses(columns: F64, lever: F64, placement: I64, sigma: F64) -> F64:
    clear = columns.reshape(len(lever), 3, -1).copy()
    for number in np.unique(placement):
        rows = placement == number
        pose = (_pose(lever[rows]) / sigma[rows, None, None]).reshape(-1, 6)
        basis = _basis(pose, _lengths(pose))
        part = clear[rows].reshape(len(basis), -1)
        clear[rows] = (part - basis @ (basis.T @ part)).reshape(-1, 3, clear.shape[2])
    return clear.reshape(columns.shape)


def _count_poses(lever: F64, placement: I64) -> int:
    """What the placements' poses take of the readings' freedom."""
    poses = [_pose(lever[placement == number]).reshape(-1, 6) for number in np.unique(placement)]
    return sum(_basis(pose, _lengths(pose)).shape[1] for pose in poses)


def _pose(lever: F64) -> F64:
    """(n, 3, 6) what shifts and turns of a placement do to its points."""
    turned = -np.cross(lever[:, None, :], np.eye(3)[None])  # (n, axis, 3)
    shifts = np.broadcast_to(np.eye(3), (len(lever), 3, 3))
    return np.concatenate([shifts, np.swapaxes(turned, 1, 2)], axis=2)


def _basis(columns: F64, whole: F64) -> F64:
    """Orthonormal, of all that the columns hold; *whole*: the columns' lengths, or what they were
    before they were clear of others."""
    return _directions(columns, whole)[0]


def _directions(columns: F64, whole: F64) -> tuple[F64, F64, F64]:
    """U, s and Vᵀ of the columns by their whole lengths, without what is weaker than WEAKEST."""
    left, values, right = np.linalg.svd(columns / whole, full_matrices=False)
    held = values > WEAKEST
    return left[:, held], values[held], right[held]


def _lengths(columns: F64) -> F64:
    """Of each column; 1 for one of zeros."""
    length = np.linalg.norm(columns, axis=0)
    return np.where(length > 0.0, length, 1.0)

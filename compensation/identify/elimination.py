"""Placements and free targets eliminated: what the readings say about the arm alone.

Whitened rows are projected orthogonally clear of the nuisances: within each placement first, then
within each session for its targets (variable projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular, svd

from armd.arrays import F64, I64
from armd.compensation.estimate.linearise import Linearisation

#: A direction of the nuisances shorter than this, relative to the longest column, says nothing.
NUISANCE_RANK = 1e-5


class Elimination:
    """Projects whitened rows clear of placements and free targets, and finds these afterwards.

    Rows are 3 n of the readings (reading by reading, x y z), ordered by session, then those that
    only concern targets: certified positions with an uncertainty, and certified distances.
    """

    def __init__(self, at: Linearisation, whitening: F64, length_floor_mm: float = 1e-6) -> None:
        """*whitening* (n, 3, 3): W with WᵀW the inverse covariance of a reading, per mm².

        A certified length or position without uncertainty counts as good to *length_floor_mm*.
        """
        self.at = at
        self.whitening = whitening
        observations = at.observations
        self._pieces: list[_Session] = []
        for session in range(len(observations.session_names)):
            rows = np.flatnonzero(observations.session == session)
            if len(rows):
                self._pieces.append(_Session(at, session, rows, whitening, length_floor_mm))

    def residual(self) -> F64:
        """Whitened residuals (m,) clear of the nuisances."""
        whitened = np.einsum("nij,nj->ni", self.whitening, self.at.residual_mm)
        return self._project(whitened[:, :, None], own_residual=True)[:, 0]

    def columns(self, columns: F64) -> F64:
        """Whitened columns (m, C) clear of the nuisances, from columns (n, 3, C) per reading."""
        return self._project(self.whitening @ columns, own_residual=False)

    @property
    def rank(self) -> int:
        """Degrees of freedom that the nuisances took."""
        return sum(piece.rank for piece in self._pieces)

    def left(self, moves: F64) -> F64:
        """(n, 3, 3) I − H of each whitened reading, H by how much it pulls its own fit: that of
        the nuisances, and of unknowns that *moves* (n, 3, C) mm, each as far as it is uncertain."""
        left = np.tile(np.eye(3), (len(self.whitening), 1, 1))
        whitened = self.whitening @ moves
        for piece in self._pieces:
            own = piece.project(whitened[piece.rows], own_residual=False)
            left[piece.rows] -= _products_by_reading(own, len(piece.rows)) + piece.pulls()
        return left

    @property
    def n_certified(self) -> int:
        """Rows of what is certified about free targets."""
        return sum(len(piece.extra_residual) for piece in self._pieces)

    @property
    def cost(self) -> float:
        """Sum of squares of all whitened residuals where the linearisation stands."""
        whitened = np.einsum("nij,nj->ni", self.whitening, self.at.residual_mm)
        extra = sum(float(np.sum(piece.extra_residual**2)) for piece in self._pieces)
        return float(np.sum(whitened**2)) + extra

    def back_substitute(self, change: F64) -> tuple[F64, F64]:
        """Twists (p, 6) and target shifts (K, 3) that answer a change (n, 3) mm of the residual:
        least squares of residual + change + nuisances, minimum norm."""
        observations = self.at.observations
        twist = np.zeros((len(observations.placement_names), 6))
        step = np.zeros((len(observations.target_names), 3))
        whitened = np.einsum("nij,nj->ni", self.whitening, self.at.residual_mm + change)
        for piece in self._pieces:
            piece.solve(whitened[piece.rows], twist, step)
        return twist, step

    def _project(self, whitened: F64, own_residual: bool) -> F64:
        return np.concatenate(
            [piece.project(whitened[piece.rows], own_residual) for piece in self._pieces]
        )


class _Session:
    """One session's nuisances: its placements' blocks, then its free targets."""

    def __init__(
        self,
        at: Linearisation,
        session: int,
        rows: I64,
        whitening: F64,
        length_floor_mm: float,
    ) -> None:
        self.at, self.rows, self.whitening = at, rows, whitening[rows]
        self.targets = at.free_targets[at.observations.target_session[at.free_targets] == session]
        self.extra_columns, self.extra_residual = _certified(at, self.targets, length_floor_mm)

    # What a trial's cost alone does not need is found when it is asked for.
    @cached_property
    def placements(self) -> list[tuple[int, I64, _Range]]:
        """Every placement's number, its rows among the session's, and its pose's range."""
        placement = self.at.observations.placement[self.rows]
        pose = self.whitening @ self.at.pose_columns[self.rows]
        found = []
        for number in np.unique(placement):
            inside = np.flatnonzero(placement == number)
            columns = pose[inside].reshape(-1, 6)
            found.append((int(number), inside, _Range(columns, np.linalg.norm(columns, axis=0))))
        return found

    @cached_property
    def target_whitened(self) -> F64:
        """(rows, 3, 3 K) whitened columns of the free targets."""
        target = self.whitening @ self.at.target_columns[self.rows]
        dense = np.zeros((len(self.rows), 3, len(self.targets), 3))
        for j, k in enumerate(self.targets):
            at_target = self.at.observations.target[self.rows] == k
            dense[at_target, :, j] = target[at_target]
        return dense.reshape(len(self.rows), 3, 3 * len(self.targets))

    @cached_property
    def target_range(self) -> _Range:
        """The free targets' range, clear of the placements', what is certified below."""
        clear = self._clear_of_placements(self.target_whitened)
        # What of a target's motion the placement explains is rounding noise, not information:
        # the yardstick is the column before it was cleared.
        before = np.linalg.norm(self.target_whitened.reshape(clear.shape), axis=0)
        return _Range(np.concatenate([clear, self.extra_columns]), before)

    @property
    def rank(self) -> int:
        return self.target_range.rank + sum(block.rank for _, _, block in self.placements)

    def pulls(self) -> F64:
        """(rows, 3, 3) by how much each reading pulls its own nuisances."""
        pulls = _products_by_reading(self.target_range.u, len(self.rows))
        for _, inside, block in self.placements:
            pulls[inside] += _products_by_reading(block.u, len(inside))
        return pulls

    def project(self, whitened: F64, own_residual: bool) -> F64:
        clear = self._clear_of_placements(whitened)
        extra = np.zeros((len(self.extra_residual), clear.shape[1]))
        if own_residual:
            extra[:, 0] = self.extra_residual
        return self.target_range.clear(np.concatenate([clear, extra]))

    def solve(self, whitened: F64, twist: F64, step: F64) -> None:
        """Fill in the steps of this session's placements and targets."""
        clear = self._clear_of_placements(whitened[:, :, None])[:, 0]
        shift = -self.target_range.solve(np.concatenate([clear, self.extra_residual]))
        step[self.targets] = shift.reshape(-1, 3)
        moved = whitened + self.target_whitened @ shift
        for placement, inside, block in self.placements:
            twist[placement] = -block.solve(moved[inside].ravel())

    def _clear_of_placements(self, whitened: F64) -> F64:
        """Rows (3 m, C) clear of every placement's pose, from (m, 3, C)."""
        clear = np.empty_like(whitened)
        for _, inside, block in self.placements:
            part = whitened[inside]
            clear[inside] = block.clear(_flat(part)).reshape(part.shape)
        return _flat(clear)


class _Range:
    """The range of a matrix: projection and minimum-norm solution."""

    def __init__(self, matrix: F64, yardstick: F64) -> None:
        least = NUISANCE_RANK * yardstick.max(initial=0.0)
        self.u, triangle = np.linalg.qr(matrix)
        if (inverse := _safe_inverse(triangle, least)) is not None:
            self.inverse = inverse
            return
        # Many singular values are nearly equal here (every target measured equally well); divide
        # and conquer, LAPACK's gesdd, now and then does not converge on such clusters.
        u, s, vt = svd(triangle, full_matrices=False, check_finite=False, lapack_driver="gesvd")
        keep = s > least
        self.u, self.inverse = self.u @ u[:, keep], vt[keep].T / s[keep]

    @property
    def rank(self) -> int:
        return int(self.u.shape[1])

    def clear(self, rows: F64) -> F64:
        cleared: F64 = rows - self.u @ (self.u.T @ rows)
        return cleared

    def solve(self, rows: F64) -> F64:
        solution: F64 = self.inverse @ (self.u.T @ rows)
        return solution


def _safe_inverse(triangle: F64, least: float) -> F64 | None:
    """The inverse of a triangular factor all of whose singular values are above *least* for sure:
    none is below one over the inverse's norm, which takes no decomposition to tell."""
    if triangle.shape[0] < triangle.shape[1] or not np.diag(triangle).all():
        return None
    inverse: F64 = solve_triangular(triangle, np.eye(len(triangle)), check_finite=False)
    return inverse if 1.0 / max(float(np.linalg.norm(inverse)), 1e-300) > least else None


def _products_by_reading(rows: F64, readings: int) -> F64:
    """(n, 3, 3) products of each reading's three rows, the first of (…, C)."""
    own = rows[: 3 * readings].reshape(readings, 3, rows.shape[1])
    products: F64 = own @ own.transpose(0, 2, 1)
    return products


def _flat(rows: F64) -> F64:
    """(3 m, C) from (m, 3, C), for any C including none."""
    m, three, c = rows.shape
    return rows.reshape(m * three, c)


def _certified(at: Linearisation, targets: I64, floor_mm: float) -> tuple[F64, F64]:
    """Rows (E, 3 K) and residuals (E,) of what is certified about a session's free targets."""
    observations, position = at.observations, at.poses.target_mm
    place = {int(k): 3 * j for j, k in enumerate(targets)}
    certified = np.flatnonzero(~observations.unknown[targets])
    uncertainty = np.repeat(observations.uncertainty_mm[targets[certified]], 3)
    of_positions = np.zeros((len(uncertainty), 3 * len(targets)))
    axes = (3 * certified[:, None] + np.arange(3)).ravel()
    of_positions[np.arange(len(axes)), axes] = 1.0 / uncertainty
    off = (position - observations.position_mm)[targets[certified]].ravel() / uncertainty
    rows: list[F64] = []
    residual: list[float] = []
    distances = observations.distances
    uncertain = np.maximum(distances.standard_uncertainty_mm, floor_mm)
    found, directions = at.poses.apart(distances.between)
    for i, (a, b) in enumerate(distances.between):
        if found[i] == 0 or not (a in place or b in place):
            continue
        rows.append(np.zeros(3 * len(targets)))
        for k, sign in ((a, 1.0), (b, -1.0)):
            if k in place:
                rows[-1][place[k] : place[k] + 3] = sign * directions[i] / uncertain[i]
        residual.append((found[i] - distances.length_mm[i]) / uncertain[i])
    of_distances = np.array(rows).reshape(len(rows), 3 * len(targets))
    return np.vstack([of_positions, of_distances]), np.append(off, residual)

"""The model around a point: residuals, parameter Jacobian, and what only nuisances explain.

Nuisances are the placements (six columns each) and the targets nobody certified exactly (three
columns each). They are eliminated by orthogonal projection: within each placement first, then
within each session for its targets, so that the parameters' columns that remain are what the
readings really say about the arm (variable projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from armd.compensation import parameters
from armd.compensation.basis import basis_values, parameter_rows
from armd.compensation.identify.observations import Observations
from armd.compensation.identify.poses import Poses, centres, pose_columns, target_columns
from armd.compensation.kinematics import jacobian
from armd.compensation.terms import Term

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

#: A direction of the nuisances shorter than this, relative to the longest column, says nothing.
NUISANCE_RANK = 1e-5


@dataclass(frozen=True)
class Linearisation:
    """Residuals (n, 3) mm in the base frame, tip minus target, and how they move.

    With parameter changes δ (per row: constants' plus coefficient × basis value), twists w of the
    placements and shifts s of the targets:
    residual + jacobian·δ + pose_columns·w[placement] + target_columns·s[target].
    """

    observations: Observations
    poses: Poses
    position_mm: F64  # (n, 3) tip, base frame
    residual_mm: F64  # (n, 3)
    jacobian: F64  # (n, 3, P) d residual / d parameter, ordered as `parameters`
    basis: F64  # (n, T) values of the terms' basis functions
    centre_mm: F64  # (p, 3) what the placements' twists turn about
    pose_columns: F64  # (n, 3, 6)
    target_columns: F64  # (n, 3, 3); zero where the row's own truth counts
    free_targets: I64  # targets that move: unknown seats, and positions with an uncertainty

    def rows(self, mask: npt.NDArray[np.bool_]) -> Linearisation:
        """The same linearisation with some readings only."""
        return replace(
            self,
            observations=(chosen := self.observations.rows(mask)),
            position_mm=self.position_mm[mask],
            residual_mm=self.residual_mm[mask],
            jacobian=self.jacobian[mask],
            basis=self.basis[mask],
            pose_columns=self.pose_columns[mask],
            target_columns=self.target_columns[mask],
            free_targets=_free_targets(chosen),
        )

    def constant_columns(self, names: Sequence[str]) -> F64:
        """d residual / d constant (n, 3, len(names))."""
        n_joints = self.observations.arm.n_joints
        return self.jacobian[:, :, [parameters.index(name, n_joints) for name in names]]

    def term_columns(self, terms: Sequence[Term], basis: F64) -> F64:
        """d residual / d coefficient (n, 3, T): the parameter's column times the basis (n, T)."""
        return self.constant_columns([term.parameter for term in terms]) * basis[:, None, :]


def linearise(
    observations: Observations,
    constants: F64,
    terms: Sequence[Term],
    poses: Poses,
    reference_c: float,
    basis: F64 | None = None,
) -> Linearisation:
    """Linearise about constants (P,) in mm and rad, the terms' coefficients, and *poses*.

    A row with a missing temperature that a term needs has NaN throughout; leave such rows out
    beforehand. *basis* (n, T): the terms' values, where already known.
    """
    states, arm = observations.states, observations.arm
    if basis is None:
        basis = basis_values(terms, states, arm, reference_c, constants)
    position, columns = jacobian(states.q, parameter_rows(constants, terms, basis))
    placed = poses.placed(observations)
    centre = centres(observations, placed)
    return Linearisation(
        observations=observations,
        poses=poses,
        position_mm=position,
        residual_mm=position - placed,
        jacobian=columns,
        basis=basis,
        centre_mm=centre,
        pose_columns=pose_columns(observations, placed, centre),
        target_columns=target_columns(observations, poses),
        free_targets=_free_targets(observations),
    )


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
        pose = whitening @ at.pose_columns
        target = whitening @ at.target_columns
        for session in range(len(observations.session_names)):
            rows = np.flatnonzero(observations.session == session)
            if len(rows):
                piece = _Session(at, session, rows, pose[rows], target[rows], length_floor_mm)
                self._pieces.append(piece)

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

    @property
    def reading_rows(self) -> npt.NDArray[np.bool_]:
        """(m,) which rows belong to readings."""
        kinds = [
            (np.ones(3 * len(piece.rows), dtype=bool), np.zeros(len(piece.extra_residual), bool))
            for piece in self._pieces
        ]
        return np.concatenate([part for pair in kinds for part in pair])

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
        pose: F64,
        target: F64,
        length_floor_mm: float,
    ) -> None:
        observations = at.observations
        self.rows = rows
        self.placements: list[tuple[int, I64, _Range]] = []
        for placement in np.unique(observations.placement[rows]):
            inside = np.flatnonzero(observations.placement[rows] == placement)
            columns = pose[inside].reshape(-1, 6)
            block = _Range(columns, np.linalg.norm(columns, axis=0))
            self.placements.append((int(placement), inside, block))
        mine = observations.target_session[at.free_targets] == session
        self.targets = at.free_targets[mine]
        self.extra_columns, self.extra_residual = _certified(at, self.targets, length_floor_mm)
        dense = np.zeros((len(rows), 3, len(self.targets), 3))
        for j, k in enumerate(self.targets):
            at_target = observations.target[rows] == k
            dense[at_target, :, j] = target[at_target]
        self.target_whitened = dense.reshape(len(rows), 3, 3 * len(self.targets))
        clear = self._clear_of_placements(self.target_whitened)
        # What of a target's motion the placement explains is rounding noise, not information:
        # the yardstick is the column before it was cleared.
        before = np.linalg.norm(self.target_whitened.reshape(clear.shape), axis=0)
        self.target_range = _Range(np.concatenate([clear, self.extra_columns]), before)

    @property
    def rank(self) -> int:
        return self.target_range.rank + sum(block.rank for _, _, block in self.placements)

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
    """The range of a matrix, by singular values: projection and minimum-norm solution."""

    def __init__(self, matrix: F64, yardstick: F64) -> None:
        orthonormal, triangle = np.linalg.qr(matrix)  # first: tall matrices are slow to decompose
        u, s, vt = np.linalg.svd(triangle, full_matrices=False)
        keep = s > NUISANCE_RANK * yardstick.max(initial=0.0)
        self.u, self.s, self.v = orthonormal @ u[:, keep], s[keep], vt[keep].T

    @property
    def rank(self) -> int:
        return len(self.s)

    def clear(self, rows: F64) -> F64:
        cleared: F64 = rows - self.u @ (self.u.T @ rows)
        return cleared

    def solve(self, rows: F64) -> F64:
        solution: F64 = self.v @ ((self.u.T @ rows) / self.s)
        return solution


def _flat(rows: F64) -> F64:
    """(3 m, C) from (m, 3, C), for any C including none."""
    m, three, c = rows.shape
    return rows.reshape(m * three, c)


def _free_targets(observations: Observations) -> I64:
    """Targets that readings without their own truth touch, and whose position may move."""
    touched = np.unique(observations.target[~observations.has_truth])
    movable = observations.unknown | (observations.uncertainty_mm > 0)
    return touched[movable[touched]]


def _certified(at: Linearisation, targets: I64, floor_mm: float) -> tuple[F64, F64]:
    """Rows (E, 3 K) and residuals (E,) of what is certified about a session's free targets."""
    observations, position = at.observations, at.poses.target_mm
    place = {int(k): 3 * j for j, k in enumerate(targets)}
    rows: list[F64] = []
    residual: list[float] = []
    for k, at_column in place.items():
        if not observations.unknown[k]:
            u = observations.uncertainty_mm[k]
            for axis in range(3):
                rows.append(np.zeros(3 * len(targets)))
                rows[-1][at_column + axis] = 1.0 / u
                residual.append((position[k, axis] - observations.position_mm[k, axis]) / u)
    distances = observations.distances
    for (a, b), length, u in zip(
        distances.between, distances.length_mm, distances.standard_uncertainty_mm, strict=True
    ):
        apart = position[a] - position[b]
        found = float(np.linalg.norm(apart))
        if found == 0 or not (a in place or b in place):
            continue
        u = max(float(u), floor_mm)
        rows.append(np.zeros(3 * len(targets)))
        for k, sign in ((a, 1.0), (b, -1.0)):
            if k in place:
                rows[-1][place[k] : place[k] + 3] = sign * apart / found / u
        residual.append((found - length) / u)
    return np.array(rows).reshape(len(rows), 3 * len(targets)), np.array(residual)

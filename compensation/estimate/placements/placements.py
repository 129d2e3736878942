"""Placements and free targets fitted along with all other columns of a problem.

A session's problem has the poses of its placements, its free targets, and all other columns. Poses
are eliminated first; the sum over a session's placements, with certified values, is the problem of
its targets. These are eliminated, too, and the sum over sessions is the problem of the others alone
(variable projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.in_order import run_in_order
from armd.compensation.estimate.group_rows import split_alike
from armd.compensation.estimate.linear.linear_model import Layout, LinearModel
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.placements.eliminate import (
    EliminatedSession,
    SessionColumns,
    eliminate,
    split_into_batches,
)

OTHERS = "others"
#: Readings per session from which threads are used: below, threads wait for the interpreter.
#: Elapsed time of calibrations on two processors, with threads and without: 1.3 and 1.0 s for 100
#: readings, 10.8 and 8.5 s for 200, 41.6 and 41.9 s for 1600, 51 and 57 s for 4000.
LARGE = 1600


@dataclass(frozen=True)
class Placements:
    """The linear problem of *remaining_columns*, poses and free targets being fitted along.

    The columns are c (n, 3, …) mm. *whitening* (n, 3, 3): W with WᵀW the inverse covariance of a
    reading, per mm². *certified* returns, for a session, whitened rows (E, 3 K) of certified values
    of its K free targets, and residuals (E,), which count in the last of the others.
    """

    observations: Observations
    pose: F64  # (n, 3, 6) mm
    target: F64  # (n, 3, 3) mm, columns of each reading's own target
    free_targets: I64
    remaining_columns: Sequence[F64]  # joined placement by placement: together they are large
    whitening: F64
    certified: Callable[[int], tuple[F64, F64]] | None = None
    full_problem: Placements | None = None  # a problem in which other readings have weight, too

    @cached_property
    def reduced_model(self) -> LinearModel:
        """The problem of the others."""
        c = self._n_others
        gram, squared_norm = np.zeros((c, c)), np.zeros(c)
        for session in self._sessions.values():
            gram += session.gram
            squared_norm += session.squared_norm
        layout = Layout(((OTHERS, c),))
        return LinearModel.from_products(
            layout, gram, np.full(c, np.inf), squared_norm=squared_norm
        )

    @property
    def rank(self) -> int:
        """The degrees of freedom that placements and targets took."""
        return sum(session.rank for session in self._sessions.values())

    def follow(self, amplitudes: F64, session_numbers: I64 | None = None) -> tuple[F64, F64]:
        """Return twists (p, 6) and target shifts (K, 3) that fit the others' *amplitudes* (c,).

        They are least squares, of minimum norm; 0 for all but *session_numbers*, if given.
        """
        twist = np.zeros((len(self.observations.placement_names), 6))
        shift = np.zeros((len(self.observations.target_names), 3))
        sessions = self._sessions
        for number in sessions if session_numbers is None else session_numbers.tolist():
            session = sessions[number]
            twists, shifts = session.follow(amplitudes)
            shift[session.columns.targets] = shifts.reshape(-1, 3)
            twist[list(session.columns.rows)] = twists
        return twist, shift

    def compute_shifting(self, session: int) -> F64:
        """Return shifts (3 K, c) of a session's free targets per amplitude, as in `follow`."""
        return self._sessions[session].following

    def compute_residual_share(self, root: F64) -> F64:
        """Return the share (n, 3, 3) I − H that the fit leaves of each whitened reading.

        H is the reading's leverage on its own fit: by placements, targets, and the others, whose
        covariance is *root* (c, r) times its transpose.
        """
        residual_share = np.tile(np.eye(3), (len(self.whitening), 1, 1))
        for session in self._sessions.values():
            k, shift_factor = 3 * len(session.columns.targets), session.shift_factor
            turned = session.shift_projected @ root
            no_target = np.zeros((3, k))
            by_target = np.vstack([shift_factor, no_target]).reshape(k // 3 + 1, 3, k)
            for rows, factor, projected in zip(
                session.columns.rows.values(),
                session.pose_factor,
                session.pose_projected,
                strict=True,
            ):
                columns, of_target = self._whiten(rows)
                pose = _multiply(columns[:, :, :6], factor)
                shifts = of_target @ by_target[self._slot[rows]]
                shifts -= _multiply(pose, projected[:, :k] @ shift_factor)
                remainder = _multiply(columns[:, :, 6:], root)
                remainder -= _multiply(pose, projected[:, k:] @ root) + _multiply(shifts, turned)
                root_columns = np.concatenate([pose, shifts, remainder], axis=2)
                residual_share[rows] -= root_columns @ root_columns.transpose(0, 2, 1)
        return residual_share

    @cached_property
    def _sessions(self) -> dict[int, EliminatedSession]:
        """The eliminated sessions by number, ascending."""
        rows = self.observations.rows_by_session
        sessions: dict[int, EliminatedSession] = {}
        if self.full_problem is not None:
            of_whole = self.full_problem._sessions
            sessions = {
                number: of_whole[number] for number in rows if self._is_as_in_full_problem(number)
            }
            sessions |= {
                number: EliminatedSession.make_weightless(columns, self._n_others)
                for number, columns in self._weightless.items()
            }
        unsolved = [
            SessionColumns(number, rows_by_placement, self.list_free_targets(number))
            for number, rows_by_placement in rows.items()
            if number not in sessions
        ]
        solve = partial(
            eliminate, whitened=self._whiten, touched=self._slot, certified=self.certified
        )
        batches = split_into_batches(unsolved, self._n_others)
        large = len(self.observations.session) > LARGE * len(rows)
        solved = run_in_order(solve, batches) if large else map(solve, batches)
        for session in itertools.chain.from_iterable(solved):
            sessions[session.columns.number] = session
        return {number: sessions[number] for number in rows}

    def _is_as_in_full_problem(self, number: int) -> bool:
        """Return whether no reading of a session has another weight in the full problem."""
        if number in self._weighed_otherwise or self.full_problem is None:
            return False
        return np.array_equal(
            self.list_free_targets(number), self.full_problem.list_free_targets(number)
        )

    @cached_property
    def _weighed_otherwise(self) -> frozenset[int]:
        """The sessions of which a reading has another weight in the full problem."""
        assert self.full_problem is not None
        otherwise = np.any(self.whitening != self.full_problem.whitening, axis=(1, 2))
        return frozenset(np.unique(self.observations.session[otherwise]).tolist())

    @property
    def _weightless(self) -> dict[int, SessionColumns]:
        """The sessions without weight and without free targets: they are held out whole."""
        weighs = np.bincount(self.observations.session, np.any(self.whitening, axis=(1, 2)))
        return {
            number: SessionColumns(number, rows, targets)
            for number, rows in self.observations.rows_by_session.items()
            if weighs[number] == 0.0 and not len(targets := self.list_free_targets(number))
        }

    @property
    def _n_others(self) -> int:
        return sum(columns.shape[2] for columns in self.remaining_columns)

    def list_free_targets(self, session: int) -> I64:
        """Return the free targets of a session."""
        return self._targets_by_session.get(session, self.free_targets[:0])

    @cached_property
    def _targets_by_session(self) -> dict[int, I64]:
        return group_targets(self.observations, self.free_targets)

    @cached_property
    def _slot(self) -> I64:
        """The index (n,) of each row's target among its session's free ones; -1 if not free."""
        place = np.full(len(self.observations.target_names), -1)
        for targets in self._targets_by_session.values():
            place[targets] = np.arange(len(targets))
        slot: I64 = place[self.observations.target]
        return slot

    def _whiten(self, rows: I64) -> tuple[F64, F64]:
        """Return whitened columns (m, 3, 6 + c) of *rows* and their targets' (m, 3, 3).

        The poses' columns are first.
        """
        columns = [self.pose[rows], *(block[rows] for block in self.remaining_columns)]
        whitening = self.whitening[rows]
        return whitening @ np.concatenate(columns, axis=2), whitening @ self.target[rows]


def group_targets(observations: Observations, free_targets: I64) -> dict[int, I64]:
    """Return the *free_targets* (F,) of each session that has any."""
    session = observations.target_session[free_targets]
    return {int(session[part[0]]): free_targets[part] for part in split_alike([session])}


def _multiply(columns: F64, matrix: F64) -> F64:
    """Multiply columns (m, 3, a) by a matrix (a, b), as one product."""
    m, axes, a = columns.shape
    product: F64 = (columns.reshape(m * axes, a) @ matrix).reshape(m, axes, matrix.shape[1])
    return product

"""Placements and free targets fitted along with whatever else readings tell of.

One `LinearModel` per placement: its pose, its session's free targets, and all other columns. The
pose is fitted along; the sum over a session's placements, with what is certified, tells its
targets; they are fitted along, too, and the sum over sessions is the problem of the others alone
(variable projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import add

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.in_order import in_order
from armd.compensation.estimate.linear.linear_model import Layout, LinearModel
from armd.compensation.estimate.linear.solution import FittedAlong
from armd.compensation.estimate.observations import Observations

POSE, TARGETS, OTHERS = "pose", "targets", "others"
#: Readings a session, from which on its products are worth a thread: below, threads take turns at
#: the interpreter. Calibrations on two processors, by the clock, in threads and without: 1.3 and
#: 1.0 s with 100, 10.8 and 8.5 s with 200, 41.6 and 41.9 s with 1600, 51 and 57 s with 4000.
LARGE = 1600


@dataclass(frozen=True)
class _Placement:
    number: int
    rows: I64
    pose: FittedAlong


@dataclass(frozen=True)
class _Session:
    number: int
    targets: I64  # its free ones
    placements: list[_Placement]
    shifts: FittedAlong
    others: LinearModel


@dataclass(frozen=True)
class Placements:
    """The linear problem of *others*, c columns (n, 3, …) mm, poses and free targets fitted along.

    *whitening* (n, 3, 3): W with WᵀW the inverse covariance of a reading, per mm². *certified*
    gives whitened rows (E, 3 K + c) of what is certified about K targets.
    """

    observations: Observations
    pose: F64  # (n, 3, 6) mm
    target: F64  # (n, 3, 3) mm, of each reading's own
    free_targets: I64
    others: Sequence[F64]  # joined placement by placement: all of them are large
    whitening: F64
    certified: Callable[[I64], F64] | None = None
    whole: Placements | None = None  # the same where other readings weigh something, if known

    @cached_property
    def alone(self) -> LinearModel:
        """The problem of the others."""
        return reduce(add, (session.others for session in self._sessions))

    @property
    def rank(self) -> int:
        """Degrees of freedom that placements and targets took."""
        return sum(
            session.shifts.rank + sum(placement.pose.rank for placement in session.placements)
            for session in self._sessions
        )

    def followed(self, amplitudes: F64) -> tuple[F64, F64]:
        """Twists (p, 6) and target shifts (K, 3) that answer the others' *amplitudes* (c,): least
        squares, of minimum norm."""
        twist = np.zeros((len(self.observations.placement_names), 6))
        shift = np.zeros((len(self.observations.target_names), 3))
        for session in self._sessions:
            shifts = session.shifts.following @ amplitudes
            shift[session.targets] = shifts.reshape(-1, 3)
            for placement in session.placements:
                drivers = np.append(shifts, amplitudes)
                twist[placement.number] = placement.pose.following @ drivers
        return twist, shift

    def shifting(self, session: int) -> F64:
        """(3 K, c) shifts of a session's K free targets that answer the others' amplitudes, as
        `followed`."""
        return next(s.shifts.following for s in self._sessions if s.number == session)

    def left(self, root: F64) -> F64:
        """(n, 3, 3) I − H of each whitened reading, H by how much it pulls its own fit: that of
        placements, of targets, and of the others, their covariance being *root* (c, r) times its
        transpose."""
        residual_share = np.tile(np.eye(3), (len(self.whitening), 1, 1))
        for session in self._sessions:
            for placement in session.placements:
                columns = self._rows(session.targets, placement.rows)
                pose, remainder = columns[:, :, :6], columns[:, :, 6:]
                remainder = remainder + pose @ placement.pose.following
                targets, remaining_columns = np.split(remainder, [3 * len(session.targets)], axis=2)
                remaining_columns = remaining_columns + targets @ session.shifts.following
                for root_columns in (
                    pose @ placement.pose.factor,
                    targets @ session.shifts.factor,
                    remaining_columns @ root,
                ):
                    residual_share[placement.rows] -= root_columns @ root_columns.transpose(0, 2, 1)
        return residual_share

    @cached_property
    def _sessions(self) -> list[_Session]:
        numbers: list[int] = np.unique(self.observations.session).tolist()
        sessions_of_whole = {
            number: session_of_whole
            for number in numbers
            if (session_of_whole := self._in_whole(number))
        }

        def session(number: int) -> _Session:
            return sessions_of_whole.get(number) or self._session(number)

        large = len(self.observations.session) > LARGE * len(numbers)
        return list(in_order(session, numbers) if large else map(session, numbers))

    def _in_whole(self, number: int) -> _Session | None:
        """A session as found in the whole, where no reading of it weighs otherwise there."""
        if self.whole is None:
            return None
        own_rows, targets = self.observations.session == number, self.targets_of(number)
        alike = np.array_equal(self.whitening[own_rows], self.whole.whitening[own_rows])
        if not (alike and np.array_equal(targets, self.whole.targets_of(number))):
            return None
        return next(s for s in self.whole._sessions if s.number == number)

    def _session(self, number: int) -> _Session:
        placement, targets = self.observations.placement, self.targets_of(number)
        n_others = sum(columns.shape[2] for columns in self.others)
        layout = Layout(((POSE, 6), (TARGETS, 3 * len(targets)), (OTHERS, n_others)))
        session_model = LinearModel.of_nothing(Layout(layout.sizes[1:]))
        of_session = np.flatnonzero(self.observations.session == number)
        placements = []
        for p in np.unique(placement[of_session]):
            rows = of_session[placement[of_session] == p]
            model = LinearModel.of_nothing(layout).measured(self._rows(targets, rows))
            reduced, pose = model.clear_of(POSE)
            session_model = session_model + reduced
            placements.append(_Placement(int(p), rows, pose))
        if self.certified:  # no yardstick of what the readings tell of a target
            session_model = replace(
                session_model.measured(self.certified(targets)), square=session_model.square
            )
        reduced_model, shifts = session_model.clear_of(TARGETS)
        return _Session(number, targets, placements, shifts, reduced_model)

    def targets_of(self, session: int) -> I64:
        """The free targets of a session."""
        session_targets: I64 = self.free_targets[
            self.observations.target_session[self.free_targets] == session
        ]
        return session_targets

    def _rows(self, targets: I64, rows: I64) -> F64:
        """(m, 3, 6 + 3 K + c) whitened: pose, *targets*, others."""
        shifting = np.zeros((len(rows), 3, len(targets), 3))
        row, slot = np.nonzero(self.observations.target[rows, None] == targets)
        shifting[row, :, slot] = self.target[rows[row]]
        flat = shifting.reshape(len(rows), 3, 3 * len(targets))
        columns = [self.pose[rows], flat, *(others[rows] for others in self.others)]
        whitened: F64 = self.whitening[rows] @ np.concatenate(columns, axis=2)
        return whitened

"""What the readings say of the arm alone, around a linearisation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.estimate.linear.solution import Solution
from armd.compensation.estimate.linearise import Linearisation
from armd.compensation.estimate.placements import Placements
from armd.compensation.estimate.poses import Poses


@dataclass(frozen=True)
class ArmAlone:
    """The linear problem of unknowns with columns (n, 3, C) mm around a linearisation, placements
    and free targets fitted along.

    *whitening* (n, 3, 3): W with WᵀW the inverse covariance of a reading, per mm². A certified
    length without uncertainty counts as good to *length_floor_mm*. *whole*: the same problem where
    other readings weigh something, too; what it found of the sessions that weigh alike holds here.
    """

    at: Linearisation
    whitening: F64
    columns: F64
    length_floor_mm: float = 1e-6
    whole: ArmAlone | None = None

    def solve(
        self,
        scale: F64,
        pull: F64,
        damping: float = 0.0,
        held: bool = False,
        chosen: I64 | slice = slice(None),
    ) -> Solution:
        """The step of the *chosen* unknowns, all by default, that leans on the drawing: that lies
        *pull* away and is good to *scale*, as `LinearModel.lean` has it."""
        numbers = np.arange(self.columns.shape[2])[chosen]
        model = self._placements.alone
        arm = replace(model.only(numbers), drawing=scale**2)
        return arm.lean(-model.gram[numbers, -1], pull, damping, held)

    @property
    def rank(self) -> int:
        """Degrees of freedom that placements and targets took."""
        return self._placements.rank

    @property
    def n_certified(self) -> int:
        """Rows of what is certified about free targets."""
        return sum(len(rows) for rows in self._certified_by_session())

    def certified_entries(self) -> I64:
        """(E, 2) what each row of what is certified is: the certificate's entry, and 0, 1, 2 for
        an axis of a position, 3 for a distance."""
        observations = self.at.observations
        entries = []
        for session in self._sessions:
            targets, distances = self._certificate_of(self._placements.targets_of(session))
            axes = np.tile(np.arange(3), len(targets))
            entries.append(np.column_stack([np.repeat(observations.certificate[targets], 3), axes]))
            numbers = observations.distances.certificate[distances]
            entries.append(np.column_stack([numbers, np.full(len(numbers), 3)]))
        return np.vstack(entries)

    def certified_rows(self) -> F64:
        """(E, C) how these rows, whitened, answer the unknowns, placements and targets fitted
        along."""
        rows_by_session = []
        for session, rows in zip(self._sessions, self._certified_by_session(), strict=True):
            shifting = self._placements.shifting(session)
            rows_by_session.append(rows[:, : len(shifting)] @ shifting[:, :-1])
        return np.vstack(rows_by_session)

    @cached_property
    def cost(self) -> float:
        """Sum of squares of all whitened residuals where the linearisation stands."""
        whitened = np.einsum("nij,nj->ni", self.whitening, self.at.residual_mm)
        certified = [rows[:, -1] for rows in self._certified_by_session()]
        return float(np.sum(whitened**2) + np.sum(np.concatenate(certified) ** 2))

    @property
    def clear_cost(self) -> float:
        """The same with placements and targets at their best, wherever they stand: half its slope
        is what `solve` finds a step by."""
        return float(self._placements.alone.gram[-1, -1])

    def clear_cost_of(self, residual_mm: F64, poses: Poses) -> float:
        """The same of other residuals (n, 3), with *poses* near by."""
        moved = replace(self.at, residual_mm=residual_mm, poses=poses)
        return replace(self, at=moved, columns=self.columns[:, :, :0], whole=None).clear_cost

    def followed(self, step: F64) -> tuple[F64, F64]:
        """Twists (p, 6) and target shifts (K, 3) that answer a *step* (C,) of the unknowns: least
        squares, of minimum norm."""
        return self._placements.followed(np.append(step, 1.0))

    def left(self, root: F64) -> F64:
        """(n, 3, 3) I − H of each whitened reading, H by how much it pulls its own fit, the
        unknowns' covariance being *root* (C, r) times its transpose."""
        return self._placements.left(np.vstack([root, np.zeros((1, root.shape[1]))]))

    @cached_property
    def _placements(self) -> Placements:
        return Placements(
            self.at.observations,
            self.at.pose_columns,
            self.at.target_columns,
            self.at.free_targets,
            (self.columns, self.at.residual_mm[:, :, None]),
            self.whitening,
            self._certified,
            self.whole._placements if self.whole else None,
        )

    @property
    def _sessions(self) -> list[int]:
        """Those with readings."""
        sessions: list[int] = np.unique(self.at.observations.session).tolist()
        return sessions

    def _certified_by_session(self) -> list[F64]:
        return [self._certified(self._placements.targets_of(session)) for session in self._sessions]

    def _certificate_of(self, targets: I64) -> tuple[I64, I64]:
        """Which of a session's free *targets*, and which distances, have rows of a certificate."""
        observations = self.at.observations
        between = observations.distances.between
        is_apart = self.at.poses.apart(between)[0] != 0
        distances: I64 = np.flatnonzero(is_apart & np.isin(between, targets).any(axis=1))
        return targets[~observations.unknown[targets]], distances

    def _certified(self, targets: I64) -> F64:
        """(E, 3 K + C + 1) rows of what is certified about a session's free *targets*: these, no
        unknown, and by how much it is missed."""
        observations, position = self.at.observations, self.at.poses.target_mm
        place = {int(k): 3 * j for j, k in enumerate(targets)}
        last = 3 * len(targets) + self.columns.shape[2]
        positions, lengths = self._certificate_of(targets)
        of_positions = np.zeros((len(positions), 3, last + 1))
        first_columns = np.array([place[k] for k in positions.tolist()], dtype=np.int64)
        uncertainty = observations.uncertainty_mm[positions]
        for axis in range(3):
            of_positions[np.arange(len(first_columns)), axis, first_columns + axis] = (
                1.0 / uncertainty
            )
        off = position[positions] - observations.position_mm[positions]
        of_positions[:, :, last] = off / uncertainty[:, None]
        rows = [of_positions.reshape(-1, last + 1)]
        distances = observations.distances
        uncertain = np.maximum(distances.standard_uncertainty_mm, self.length_floor_mm)
        lengths_mm, directions = self.at.poses.apart(distances.between)
        for i in lengths.tolist():
            of_distance = np.zeros((1, last + 1))
            for k, sign in zip(distances.between[i].tolist(), (1.0, -1.0), strict=True):
                if k in place:
                    of_distance[0, place[k] : place[k] + 3] = sign * directions[i]
            of_distance[0, last] = lengths_mm[i] - distances.length_mm[i]
            rows.append(of_distance / uncertain[i])
        return np.vstack(rows)

"""The linear problem of the arm's unknowns alone, around a linearisation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.estimate.group_rows import split_alike
from armd.compensation.estimate.linear.solution import Solution
from armd.compensation.estimate.linearise import Linearisation
from armd.compensation.estimate.placements.placements import Placements, group_targets
from armd.compensation.estimate.placements.poses import Poses

NONE = np.empty(0, dtype=np.int64)


@dataclass(frozen=True)
class ArmAlone:
    """The linear problem of C unknowns, with placements and free targets eliminated.

    *columns* (n, 3, C) mm are derivatives at the linearisation. *whitening* (n, 3, 3): W with WᵀW
    the inverse covariance of a reading, per mm². A certified length without uncertainty gets
    *length_floor_mm* as its uncertainty. *full_problem* is the same problem in which other readings
    have a weight, too; its results are reused for sessions with equal weights.
    """

    linearisation: Linearisation
    whitening: F64
    columns: F64
    length_floor_mm: float = 1e-6
    full_problem: ArmAlone | None = None

    def solve(
        self,
        scale: F64,
        pull: F64,
        damping: float = 0.0,
        along_all: bool = False,
        chosen: I64 | slice = slice(None),
    ) -> Solution:
        """Solve for the step of the *chosen* unknowns (all by default) with a nominal prior.

        The nominal values lie *pull* away, and *scale* is the plausible departure from them; see
        `LinearModel.solve_with_prior`.
        """
        numbers = np.arange(self.columns.shape[2])[chosen]
        model = self._placements.reduced_model
        arm = replace(model.only(numbers), nominal_variance=scale**2)
        return arm.solve_with_prior(-model.gram[numbers, -1], pull, damping, along_all)

    @property
    def rank(self) -> int:
        """The degrees of freedom that placements and targets took."""
        return self._placements.rank

    @property
    def n_certified(self) -> int:
        """The number of rows of certified positions and lengths of free targets."""
        return sum(len(missed) for _, missed in self._certified_by_session.values())

    def certified_entries(self) -> I64:
        """Return for each certified row (E, 2) its entry in the certificate and its kind.

        The kind is 0, 1, 2 for an axis of a position, and 3 for a distance.
        """
        observations = self.linearisation.observations
        entries = []
        for session in observations.rows_by_session:
            slots, distances = self._certificate_of(session)
            targets = self._targets_of(session)[slots]
            axes = np.tile(np.arange(3), len(targets))
            entries.append(np.column_stack([np.repeat(observations.certificate[targets], 3), axes]))
            numbers = observations.distances.certificate[distances]
            entries.append(np.column_stack([numbers, np.full(len(numbers), 3)]))
        return np.vstack(entries)

    def certified_rows(self) -> F64:
        """Return the derivatives (E, C) of the whitened certified rows by the unknowns.

        Placements and targets are fitted along.
        """
        return np.vstack(
            [
                rows @ self._placements.compute_shifting(session)[:, :-1]
                for session, (rows, _) in self._certified_by_session.items()
            ]
        )

    @cached_property
    def cost(self) -> float:
        """The sum of squares of all whitened residuals at the linearisation."""
        whitened = np.einsum("nij,nj->ni", self.whitening, self.linearisation.residual_mm)
        missed = [missed for _, missed in self._certified_by_session.values()]
        return float(np.sum(whitened**2) + np.sum(np.concatenate(missed) ** 2))

    @property
    def reduced_cost(self) -> float:
        """The cost with placements and targets at their optimum.

        Half its slope is the right-hand side from which `solve` computes a step.
        """
        return float(self._placements.reduced_model.gram[-1, -1])

    def compute_reduced_cost(self, residual_mm: F64, poses: Poses) -> float:
        """Compute `reduced_cost` for other residuals (n, 3).

        The *poses* are near those of the linearisation.
        """
        moved = replace(self.linearisation, residual_mm=residual_mm, poses=poses)
        return replace(
            self, linearisation=moved, columns=self.columns[:, :, :0], full_problem=None
        ).reduced_cost

    def follow(self, step: F64, session_numbers: I64 | None = None) -> tuple[F64, F64]:
        """Return twists (p, 6) and target shifts (K, 3) that follow a *step* (C,) of the unknowns.

        They are the least-squares solution of minimum norm; 0 for all sessions but
        *session_numbers*, if given.
        """
        return self._placements.follow(np.append(step, 1.0), session_numbers)

    def compute_residual_share(self, root: F64) -> F64:
        """Compute I − H (n, 3, 3) of each whitened reading.

        H is the share by which a reading pulls its own fit. The unknowns' covariance is *root* (C,
        r) times its transpose.
        """
        return self._placements.compute_residual_share(
            np.vstack([root, np.zeros((1, root.shape[1]))])
        )

    @cached_property
    def _placements(self) -> Placements:
        return Placements(
            self.linearisation.observations,
            self.linearisation.pose_columns,
            self.linearisation.target_columns,
            self.linearisation.free_targets,
            (self.columns, self.linearisation.residual_mm[:, :, None]),
            self.whitening,
            # A function that holds no reference to this object: with a reference cycle, Python
            # would keep all these arrays until its collector runs, which arrays hardly trigger.
            self._certified_by_session.__getitem__,
            self.full_problem._placements if self.full_problem else None,
        )

    @cached_property
    def _certified_by_session(self) -> dict[int, tuple[F64, F64]]:
        """The certified rows (E, 3 K) of each session, and their misses (E,).

        Both are whitened; the rows are derivatives by the session's K free targets.
        """
        return {
            session: self._certified(session)
            for session in self.linearisation.observations.rows_by_session
        }

    def _targets_of(self, session: int) -> I64:
        return self._targets_by_session.get(session, NONE)

    @cached_property
    def _targets_by_session(self) -> dict[int, I64]:
        return group_targets(self.linearisation.observations, self.linearisation.free_targets)

    def _certificate_of(self, session: int) -> tuple[I64, I64]:
        """Return which free targets (by index) and which distances of a session are certified."""
        is_certified = ~self.linearisation.observations.unknown[self._targets_of(session)]
        return np.flatnonzero(is_certified), self._distances_by_session.get(session, NONE)

    @cached_property
    def _distances_by_session(self) -> dict[int, I64]:
        """The distances, between targets that do not coincide, that move with a free target."""
        observations = self.linearisation.observations
        between = observations.distances.between
        if not len(between):
            return {}
        is_free = np.isin(between, self.linearisation.free_targets).any(axis=1)
        numbers = np.flatnonzero((self._lengths[0] != 0) & is_free)
        session = observations.target_session[between[numbers, 0]]
        return {int(session[part[0]]): numbers[part] for part in split_alike([session])}

    @cached_property
    def _lengths(self) -> tuple[F64, F64]:
        return self.linearisation.poses.measure_distances(
            self.linearisation.observations.distances.between
        )

    def _certified(self, session: int) -> tuple[F64, F64]:
        observations, position = self.linearisation.observations, self.linearisation.poses.target_mm
        targets = self._targets_of(session)
        slots, distances = self._certificate_of(session)
        weight = np.repeat(1.0 / observations.uncertainty_mm[targets[slots]], 3)
        off = position[targets[slots]] - observations.position_mm[targets[slots]]
        rows = np.zeros((len(weight) + len(distances), 3 * len(targets)))
        columns = (3 * slots[:, None] + np.arange(3)).ravel()
        rows[np.arange(len(weight)), columns] = weight
        missed = [off.ravel() * weight]
        if len(distances):
            rows[len(weight) :], lengths = self._certified_lengths(targets, distances)
            missed.append(lengths)
        return rows, np.concatenate(missed)

    def _certified_lengths(self, targets: I64, numbers: I64) -> tuple[F64, F64]:
        """Return rows (D, 3 K) and misses (D,) of the distances *numbers* (D,) of K *targets*."""
        distances = self.linearisation.observations.distances
        lengths_mm, directions = self._lengths
        uncertain = np.maximum(distances.standard_uncertainty_mm, self.length_floor_mm)[numbers]
        rows = np.zeros((len(numbers), len(targets), 3))
        for end, sign in ((0, 1.0), (1, -1.0)):
            row, slot = np.nonzero(distances.between[numbers, end, None] == targets)
            rows[row, slot] = sign * directions[numbers[row]]
        missed: F64 = (lengths_mm - distances.length_mm)[numbers] / uncertain
        return rows.reshape(len(numbers), -1) / uncertain[:, None], missed

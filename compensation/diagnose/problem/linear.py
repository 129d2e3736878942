"""The values on which a fit is based: rests, model, residuals and columns around it.

Rows are flat: x, y, z of every rest in mm, then one row per certified distance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.sessions.session import Session
from armd.compensation.effects.effect import ArtefactChange
from armd.compensation.estimate.linear.blocks import Blocks, Piece
from armd.compensation.estimate.observations import TURN_MM, Observations
from armd.compensation.estimate.placements.poses import Poses
from armd.compensation.estimate.surface_kinds import POINT
from armd.compensation.estimate.surfaces import group_planes, project_on_normals
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.calibration import ArtefactCorrection, Calibration
from armd.compensation.model.terms import Term


@dataclass(frozen=True)
class Rests:
    """The averaged readings, one row per rest, and which readings made each."""

    sessions: tuple[Session, ...]
    observations: Observations  # n rests
    artefact_rise_c: F64  # (n,) artefact temperature − its reference, 0 missing
    rest_of: I64  # (readings,) rest of each reading, through all sessions; −1 not used
    first: I64  # (n,) index of the first reading of each rest
    target_label: tuple[str, ...]  # per target: its name within the artefact
    point_of: I64  # (n,) the rest itself; of an orientation, the point with which it was measured

    @property
    def n(self) -> int:
        return self.observations.n

    @cached_property
    def points(self) -> Observations:
        """The rests that give the tip's position: all, or those before the orientations."""
        turned = self.observations.turned
        return self.observations.rows(~turned) if turned.any() else self.observations

    @cached_property
    def arm_rise_without_artefact_k(self) -> F64:
        """The arm's mean temperature (n,) K above the artefact's reference, or 0.

        It is 0 in sessions that have artefact_c.
        """
        observations = self.observations
        columns = observations.arm.used_columns
        if not columns:
            return np.zeros(self.n)
        unread = np.array([not np.isfinite(s.artefact_c).any() for s in self.sessions])
        reference_c = np.array([s.artefact.reference_temperature_c for s in self.sessions])
        mean_c = observations.states.temperature_c[:, columns].mean(axis=1)
        rise = np.nan_to_num(mean_c - reference_c[observations.session])
        return np.where(unread[observations.session], rise, 0.0)

    @cached_property
    def posture(self) -> I64:
        """The posture (n,) of each rest: copies share what the model does not know."""
        return self.observations.posture

    @cached_property
    def in_order(self) -> dict[int, I64]:
        """The rests of each placement in order of time, or of the rows where there are no times.

        An orientation follows its point.
        """
        observations = self.observations
        ordered = {}
        for number in np.unique(observations.placement):
            members = np.flatnonzero(observations.placement == number)
            time_s = np.nan_to_num(observations.states.time_s[members])
            ordered[int(number)] = members[np.lexsort((members, self.point_of[members], time_s))]
        return ordered


@dataclass(frozen=True)
class ModelState:
    """A model at one point of the search: constants, terms, corrections of the artefact."""

    constants: F64  # (P,)
    terms: tuple[Term, ...]
    reference_c: float
    artefact: ArtefactCorrection
    #: offset (3,) mm of each reflector from the tip, in the last frame
    off_tip_mm: Mapping[str, F64] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Linear:
    """Residuals and columns around a model; N = 3 n + distances rows."""

    rests: Rests
    model: ModelState
    poses: Poses
    residual: F64  # (N,) mm
    jacobian: F64  # (P, N) mm per parameter
    joints: F64  # (n, 3, joints) mm/rad, for the encoders' noise
    nuisance: Blocks  # (N, m) placements, unknown seats
    position_mm: F64  # (n, 3) tip, base frame
    normal: F64 | None = None  # (n, 3) of the surfaces touched, 0 for points; None: no surface

    def signature(self, parameter: int, values: F64) -> F64:
        """Return the column (N,) of a parameter times basis values (n,)."""
        column: F64 = self.jacobian[parameter].copy()
        column[: 3 * self.rests.n] *= np.repeat(values, 3)
        return column

    @cached_property
    def _placed_mm(self) -> F64:
        """The position (n, 3) mm where the tip should stand, in the base frame."""
        observations = self.rests.observations
        placed = self.poses.compute_target_points(observations)
        if self.normal is not None:
            off = self.residual[: 3 * self.rests.n].reshape(-1, 3)
            placed = np.where(observations.on_surface[:, None], self.position_mm - off, placed)
        return placed

    def artefact_column(self, change: ArtefactChange) -> F64:
        """Return the column (N,) of a change of the artefact: the residual is tip minus target."""
        observations = self.rests.observations
        column = np.zeros(len(self.residual))
        if change.kind == "distance":
            column[3 * self.rests.n + change.index] = -1.0
            return column
        if change.kind == "moved":
            later = self.rests.in_order[change.index][change.after :]
            moves = self._motions(change.index)[change.axis, change.after :]
            column[3 * later[:, None] + np.arange(3)] = -moves
            return column
        target_mm = observations.get_known_mm(self.poses.target_mm)
        if change.kind == "expansion":
            move = self._from_still_mm * self.rests.artefact_rise_c[:, None]
        elif change.kind == "warmth":
            move = self._from_still_mm * self.rests.arm_rise_without_artefact_k[:, None]
        elif change.kind == "scale":
            move = self._from_still_mm
        elif change.kind == "sag":
            move = self._sag(change, target_mm)
        else:
            label = np.array(self.rests.target_label)[observations.target]
            move = np.zeros((self.rests.n, 3))
            move[(label == change.target) & ~observations.has_truth, change.axis] = 1.0
        move[observations.turned] = 0.0
        if change.artefact:
            has_artefact = np.array(
                [s.artefact.name == change.artefact for s in self.rests.sessions]
            )
            move = move * has_artefact[observations.session][:, None]
        rotation = self.poses.rotation[observations.placement]
        turned = np.einsum("nij,nj->ni", rotation, move)
        if self.normal is not None:  # the third coordinate of a surface is its height or radius
            on_surface = observations.on_surface[:, None]
            turned = np.where(on_surface, self.normal * move[:, 2:], turned)
        column[: 3 * self.rests.n] = -turned.ravel()
        return column

    @cached_property
    def _from_still_mm(self) -> F64:
        """The targets' positions (n, 3) mm from the point about which the artefact grows.

        That point is the artefact's origin. Where nothing of the artefact is certified, its frame
        lies anywhere (rounding decides). A target far from the origin would then move by one
        sensor's noise times that distance. The point is then the middle of the seats, and a single
        seat does not move (docs/developer/diagnosis-how.md). Heights of planes refer to a frame
        that lies anywhere, too; a sphere grows about its own centre.
        """
        observations = self.rests.observations
        target_mm = self.poses.target_mm.copy()
        certified = observations.has_truth | observations.says_size[observations.target]
        for session in np.setdiff1d(observations.session, observations.session[certified]):
            seats = np.unique(observations.target[observations.session == session])
            seats = seats[observations.kind[seats] == POINT]
            if len(seats):
                target_mm[seats] -= target_mm[seats].mean(axis=0)
        for body in group_planes(observations):
            target_mm[body] -= target_mm[body].mean(axis=0)
        return observations.get_known_mm(target_mm)

    def artefact_columns(self, changes: Sequence[ArtefactChange]) -> Blocks:
        """Return the columns of several changes of the artefact.

        The column of a moved placement is stored in that placement.
        """
        n = self.rests.n
        of_artefact = [j for j, change in enumerate(changes) if change.kind != "moved"]
        columns = [self.artefact_column(changes[j]) for j in of_artefact]
        full = np.reshape(columns, (len(of_artefact), len(self.residual))).T
        distances = np.zeros((len(self.residual) - 3 * n, len(changes)))
        distances[:, of_artefact] = full[3 * n :]
        moved: dict[int, list[int]] = {number: [] for number in self.rests.in_order}
        for j, change in enumerate(changes):
            if change.kind == "moved":
                moved[change.index].append(j)
        pieces = []
        for number, in_time in self.rests.in_order.items():
            rests = np.sort(in_time)
            values = full[: 3 * n].reshape(n, 3, len(of_artefact))[rests]
            nonzero = values.any(axis=(0, 1))
            moves = np.zeros((len(rests), 3, len(moved[number])))
            if moved[number]:
                turn, motions = np.searchsorted(rests, in_time), self._motions(number)
            for k, j in enumerate(moved[number]):
                after = changes[j].after
                moves[turn[after:], :, k] = -motions[changes[j].axis, after:]
            numbers = np.array(
                [*np.array(of_artefact, dtype=int)[nonzero], *moved[number]], dtype=np.int64
            )
            order = np.argsort(numbers)
            motion_values = np.concatenate([values[:, :, nonzero], moves], axis=2)
            pieces.append(Piece(rests, numbers[order], motion_values[:, :, order]))
        return Blocks(n, len(changes), tuple(pieces), distances)

    def _sag(self, change: ArtefactChange, target_mm: F64) -> F64:
        """Return the motion (n, 3) of targets (n, 3) by a bend along a principal axis of all."""
        observations = self.rests.observations
        is_measured = np.isin(np.arange(len(self.poses.target_mm)), observations.target)
        points = self.poses.target_mm[is_measured & (observations.kind == POINT)]
        middle = points.mean(axis=0)
        axis = np.linalg.svd(points - middle, full_matrices=False)[2][change.axis]
        along = (
            (target_mm - middle) @ axis / max(float(np.abs((points - middle) @ axis).max()), 1.0)
        )
        across = np.array(observations.arm.gravity) @ self.poses.rotation[observations.placement]
        across -= np.outer(across @ axis, axis)
        still = observations.has_truth | observations.on_surface
        return np.where(still[:, None], 0.0, along[:, None] ** 2 * across)

    def _motions(self, placement: int) -> F64:
        """Return the motions (6, k, 3) of the targets of one placement's rests when it moves.

        The first three are shifts along each axis, the others turns about each. Rests are in the
        order of time.
        """
        rests = self.rests.in_order[placement]
        points, turned = self._placed_mm[rests], self.rests.observations.turned[rests]
        along = np.broadcast_to(np.eye(3)[:, None], (3, *points.shape))
        about = np.cross(along, points - points[~turned].mean(axis=0))
        about[:, turned] = TURN_MM * np.eye(3)[:, None]
        motions = np.concatenate([np.where(turned[:, None], 0.0, along), about])
        if self.normal is not None:
            normal = self.normal[self.rests.in_order[placement]]
            moves = project_on_normals(normal, motions.transpose(1, 2, 0))
            motions = np.ascontiguousarray(moves.transpose(2, 0, 1))
        return motions


@dataclass(frozen=True)
class Baseline:
    """The model under test: a calibration as the diagnosis uses it.

    If it is given by the user, its constants and terms are fixed, to within its covariance. If it
    was made from the same sessions, all that it identified absorbs freely.
    """

    model: ModelState
    calibration: Calibration
    is_given: bool
    parameters: tuple[int, ...]  # identified constants, by index
    terms: tuple[int, ...]  # identified terms, by index
    root: F64  # (identified, r): root of their covariance, parameters first; used if given
    #: indices of terms of growth that a given calibration could not know
    growth: tuple[int, ...] = ()

    def columns(self, linear: Linear, arm: Arm) -> F64:
        """Return the columns (N, identified) of the identified constants and terms."""
        chosen = [self.model.terms[i] for i in self.terms]
        states = linear.rests.observations.states
        probes = [term.model_copy(update={"coefficient": 1.0}) for term in chosen]
        values = compute_basis_values(
            probes, states, arm, self.model.reference_c, self.model.constants
        )
        constants = [linear.jacobian[i] for i in self.parameters]
        slopes = [
            linear.signature(arm.layout.index(term.parameter), value)
            for term, value in zip(chosen, values.T, strict=True)
        ]
        size = len(linear.residual)
        columns: F64 = np.array([*constants, *slopes]).reshape(-1, size).T
        return columns

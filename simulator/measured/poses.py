"""Finds postures with the true tip at a target: many articulations, within end stops."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import Movable
from armd.simulator.truth.effects.effect import Conditions, Posture

#: Distance kept from every end stop, rad.
MARGIN_RAD = np.radians(2.0)
#: A pose counts as solved when its tip is this close to the target, mm.
CLOSE_MM = 1e-7


class Unreachable(Exception):
    """A target has fewer articulations than requested."""


def compute_tip_jacobian(posture: Posture) -> F64:
    """Compute d tip / d joint angle (n, 3, N), mm/rad, of the rigid arm: axis × lever."""
    n_joints = len(posture.joint_rotation)
    columns = [
        np.cross(posture.rotation[k][:, :, 2], posture.tip - posture.origin[k])
        for k in range(n_joints)
    ]
    return np.stack(columns, axis=2)


def solve_posture(arm: Movable, phi: F64, goal_mm: F64, conditions: Conditions) -> F64:
    """Find angles (n, N) near *phi* with which the arm's true tip is at *goal_mm* (n, 3).

    It takes the shortest steps of the rigid arm towards the goal. Imperfections change the tip so
    little that each step leaves about a thousandth of the way.
    """
    phi = phi.copy()
    for _ in range(12):
        rigid = arm.posture(phi, conditions)
        way_mm = goal_mm - (rigid.tip if arm.is_rigid else arm.tip(phi, conditions))
        if np.abs(way_mm).max() < CLOSE_MM:
            break
        jacobian = compute_tip_jacobian(rigid)
        squared = jacobian @ jacobian.transpose(0, 2, 1) + 1e-6 * np.eye(3)
        step = jacobian.transpose(0, 2, 1) @ np.linalg.solve(squared, way_mm[:, :, None])
        phi += np.clip(step[:, :, 0], -0.4, 0.4)
    return phi


class Reach:
    """The reach of the arm: a cloud of postures as starting points."""

    def __init__(
        self,
        arm: Movable,
        rng: np.random.Generator,
        limits_rad: tuple[F64, F64] | None = None,
        size: int = 12000,
    ) -> None:
        self._arm = arm.as_rigid()
        self._rng = rng
        low, high = nominal.get_limits_rad(arm.n_joints) if limits_rad is None else limits_rad
        self._low, self._high = low + MARGIN_RAD, high - MARGIN_RAD
        self._phi = rng.uniform(self._low, self._high, (size, arm.n_joints))
        self._tip = self._arm.tip(self._phi, Conditions.at_rest(size, arm.n_joints))
        from scipy.spatial import cKDTree  # a simulated arm on a wire does not need it

        self._tree = cKDTree(self._tip)

    def articulations(self, goals_mm: F64, count: int) -> F64:
        """Return *count* different postures for each goal (K, 3): (K, count, N).

        Raises `Unreachable` if a goal has too few.
        """
        tries = 4 * count + 12
        near_rows = np.asarray(self._tree.query(goals_mm, k=8 * tries)[1])
        picked = np.array([self._rng.choice(row, tries, replace=False) for row in near_rows])
        start = self._phi[picked.ravel()]
        goal = np.repeat(goals_mm, tries, axis=0)
        still = Conditions.at_rest(len(start), start.shape[1])
        phi = solve_posture(self._arm, start, goal, still)
        missed = np.linalg.norm(self._arm.tip(phi, still) - goal, axis=1)
        inside = ((phi >= self._low) & (phi <= self._high)).all(axis=1)
        good = (inside & (missed < 1e-3)).reshape(len(goals_mm), tries)
        phi = phi.reshape(len(goals_mm), tries, -1)
        if (good.sum(axis=1) < count).any():
            worst = goals_mm[int(good.sum(axis=1).argmin())].round(1).tolist()
            raise Unreachable(f"fewer than {count} articulations at {worst} mm")
        return np.array([self._spread(row[ok], count) for row, ok in zip(phi, good, strict=True)])

    def _spread(self, phi: F64, count: int) -> F64:
        """Choose *count* postures that differ: each next one is the farthest from those chosen."""
        chosen = [int(self._rng.integers(len(phi)))]
        gap = np.full(len(phi), np.inf)
        while len(chosen) < count:
            gap = np.minimum(gap, np.linalg.norm(phi - phi[chosen[-1]], axis=1))
            gap[chosen[-1]] = -1.0
            chosen.append(int(gap.argmax()))
        return phi[chosen]

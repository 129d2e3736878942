"""Gauss–Newton on the unknowns, with Levenberg's damping where a step fails."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.compensation.basis import parameter_rows
from armd.compensation.identify.elimination import Elimination
from armd.compensation.identify.linearise import Linearisation, linearise
from armd.compensation.identify.noise import Weighting
from armd.compensation.identify.observations import Observations
from armd.compensation.identify.poses import Poses, fit_poses
from armd.compensation.identify.solution import Solution, solve
from armd.compensation.identify.unknowns import Unknowns
from armd.compensation.kinematics import forward
from armd.compensation.terms import Term

F64 = npt.NDArray[np.float64]

MOST_STEPS = 40


@dataclass(frozen=True)
class End:
    """Where a descent came to rest."""

    x: F64
    at: Linearisation
    elimination: Elimination
    solution: Solution
    steps: int
    converged: bool


@dataclass(frozen=True)
class Descent:
    """One round: basis values and the noise of the angles are held while the unknowns move."""

    observations: Observations
    constants: F64
    terms: list[Term]
    unknowns: Unknowns
    reference_c: float
    basis: F64
    start: F64  # (C,) what unidentifiable directions stay near
    weighting: Weighting

    def run(self, x: F64, poses: Poses, floor_mm: float, held: bool) -> End:
        """Step until what a step would gain is nothing beside the noise."""
        scale = self.unknowns.plausible(self.terms, self.basis)

        at, elimination = self._linearise(x, poses, floor_mm, held)
        damping = 0.0
        steps = 0
        while steps < MOST_STEPS:
            steps += 1
            columns = self.unknowns.columns(at.jacobian, at.basis, self.terms)
            clear = np.column_stack([elimination.columns(columns * scale), elimination.residual()])
            triangle = np.asarray(np.linalg.qr(clear, mode="r"))
            solution = solve(triangle, scale, self.start - x, held=held)
            converged = solution.gain < 1e-6 + 1e-8 * elimination.cost
            if converged:
                break
            while True:
                damped = solve(triangle, scale, self.start - x, damping, held)
                twist, shift = elimination.back_substitute(columns @ damped.step)
                moved = at.poses.moved(at.centre_mm, twist, shift)
                trial = self._linearise(x + damped.step, moved, floor_mm, held)
                there = x + damped.step
                before = elimination.cost + solution.off_drawing(x - self.start)
                better = trial[1].cost + solution.off_drawing(there - self.start) <= before
                if better or damping > 1e3:
                    break
                damping = max(10.0 * damping, 1e-6)
            if not better:  # no step gains anything
                converged = solution.gain < 1e-3
                break
            x = x + damped.step
            at, elimination = trial
            damping = damping / 10.0 if damping > 1e-8 else 0.0
        return End(x, at, elimination, solution, steps, converged)

    def _linearise(
        self, x: F64, poses: Poses, floor_mm: float, held: bool
    ) -> tuple[Linearisation, Elimination]:
        constants, terms = self.unknowns.put(x, self.constants, self.terms)
        if held and not len(self.observations.distances.length_mm):
            # Far off, poses are not linear: about a beam's own axis they turn by any angle.
            rows = parameter_rows(constants, terms, self.basis)
            position = forward(self.observations.states.q, rows)[0]
            poses = fit_poses(self.observations, position, self.weighting.weight, poses)
        at = linearise(self.observations, constants, terms, poses, self.reference_c, self.basis)
        return at, Elimination(at, self.weighting.whitening(at.joints), floor_mm)

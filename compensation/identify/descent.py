"""Gauss–Newton on the unknowns, with Levenberg's damping where a step fails."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.estimate.linearise import Linearisation, linearise
from armd.compensation.estimate.noise import Weighting
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.poses import Poses, fit_poses
from armd.compensation.estimate.solution import Solution, solve
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.elimination import Elimination
from armd.compensation.model.basis import parameter_rows
from armd.compensation.model.kinematics import forward
from armd.compensation.model.terms import Term

MOST_STEPS = 40
#: Where a step promises less than this share of the cost, columns and cost need not agree to the
#: last: columns are taken where the angles have been adjusted, and how they change is left out of
#: the cost. There the step is right, which `converged` tells by what a next one would gain.
NEAR = 0.01
#: A step that promises less (χ²) and does not keep it is not tried again with damping: forty short
#: ones would crawl towards what no figure shows.
NOTHING = 1e-3


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
class _Place:
    """Where a descent stands."""

    x: F64
    at: Linearisation
    elimination: Elimination


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

        here = _Place(x, *self._linearise(x, poses, floor_mm, held))
        damping = 0.0
        steps = 0
        while steps < MOST_STEPS:
            steps += 1
            triangle = self._triangle(here, scale)
            solution = solve(triangle, scale, self.start - here.x, held=held)
            converged = solution.gain < 1e-6 + 1e-8 * here.elimination.cost
            if converged:
                break

            def cost(place: _Place, solution: Solution = solution) -> float:
                return place.elimination.cost + solution.off_drawing(place.x - self.start)

            most = cost(here) + (solution.gain if solution.gain < NEAR * cost(here) else 0.0)
            while True:
                damped = solve(triangle, scale, self.start - here.x, damping, held)
                there = self._moved(here, damped.step, floor_mm, held)
                if cost(there) > most:
                    # The way may bend, where a link turns with what hangs on it: a second step
                    # from there comes back to the valley's floor.
                    pull = self.start - there.x
                    second = solve(self._triangle(there, scale), scale, pull, damping, held)
                    there = self._moved(there, second.step, floor_mm, held)
                better = cost(there) <= most
                if better or damping > 1e3 or solution.gain < NOTHING:
                    break
                damping = max(10.0 * damping, 1e-6)
            if not better:  # no step gains anything
                converged = solution.gain < NOTHING
                break
            here = there
            damping = damping / 10.0 if damping > 1e-8 else 0.0
        return End(here.x, here.at, here.elimination, solution, steps, converged)

    def _triangle(self, here: _Place, scale: F64) -> F64:
        """Triangular factor (·, C+1) of the scaled columns and the residual, clear of nuisances."""
        columns = self.unknowns.columns(here.at.jacobian, here.at.basis, self.terms)
        elimination = here.elimination
        clear = np.column_stack([elimination.columns(columns * scale), elimination.residual()])
        return np.asarray(np.linalg.qr(clear, mode="r"))

    def _moved(self, here: _Place, step: F64, floor_mm: float, held: bool) -> _Place:
        """After a step (C,) of the unknowns, placements and targets following."""
        columns = self.unknowns.columns(here.at.jacobian, here.at.basis, self.terms)
        twist, shift = here.elimination.back_substitute(columns @ step)
        poses = here.at.poses.moved(here.at.centre_mm, twist, shift)
        return _Place(here.x + step, *self._linearise(here.x + step, poses, floor_mm, held))

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

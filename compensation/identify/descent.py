"""Gauss–Newton on the unknowns, with Levenberg's damping where a step fails."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from armd.arrays import F64
from armd.compensation.estimate.fit_poses import fit_poses
from armd.compensation.estimate.linear.solution import Solution
from armd.compensation.estimate.linearise import Linearisation, linearise
from armd.compensation.estimate.noise import Weighting
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.orientations import observe
from armd.compensation.estimate.poses import Poses
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.arm_alone import ArmAlone
from armd.compensation.model.basis import parameter_rows
from armd.compensation.model.terms import Term

MOST_STEPS = 40
#: A step that promises less than this share of the cost may be judged by what it was made of:
#: weights and adjusted angles held. How they follow is left out of the columns, and beside so small
#: a promise that shows (docs/decisions/0027). One that promises more is judged with both following.
NEAR = 0.01
#: A step that promises less (χ²) and does not keep it is not tried again with damping: forty short
#: ones would crawl towards what no figure shows.
NOTHING = 1e-3


@dataclass(frozen=True)
class End:
    """Where a descent came to rest."""

    x: F64
    at: Linearisation
    alone: ArmAlone
    solution: Solution
    steps: int
    converged: bool


@dataclass(frozen=True)
class _Place:
    """Where a descent stands."""

    x: F64
    at: Linearisation
    alone: ArmAlone


@dataclass
class _Trial:
    """Where a step leads; what it is there is found when it is asked for."""

    descent: Descent
    x: F64
    poses: Poses
    floor_mm: float
    held: bool

    @cached_property
    def place(self) -> _Place:
        """Linearised there."""
        return _Place(self.x, *self.descent.linearise(self.x, self.poses, self.floor_mm, self.held))


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

    def run(self, x: F64, begun: Linearisation, floor_mm: float, held: bool) -> End:
        """Step until what a step would gain is nothing beside the noise; *begun*: at *x* (C,), with
        poses to begin with."""
        scale = self.unknowns.get_plausible(self.terms, self.basis)

        if self._poses_anew(held):
            here = _Place(x, *self.linearise(x, begun.poses, floor_mm, held))
        else:
            here = _Place(x, begun, self._alone(begun, floor_mm))
        damping = 0.0
        steps = 0
        while steps < MOST_STEPS:
            steps += 1
            pull = self.start - here.x
            solution = here.alone.solve(scale, pull, held=held)
            converged = solution.gain < 1e-6 + 1e-8 * here.alone.cost
            if converged:
                break

            while True:
                damped = here.alone.solve(scale, pull, damping, held) if damping else solution
                trial = self._moved(here, damped.step, floor_mm, held)
                better = self._better(here, trial, solution, held)
                if not better:
                    # The way may bend, where a link turns with what hangs on it: a second step
                    # from there comes back to the valley's floor.
                    bent = self.start - trial.x
                    second = trial.place.alone.solve(scale, bent, damping, held)
                    trial = self._moved(trial.place, second.step, floor_mm, held)
                    better = self._better(here, trial, solution, held)
                if better or damping > 1e3 or solution.gain < NOTHING:
                    break
                damping = max(10.0 * damping, 1e-6)
            if not better:  # no step gains anything
                converged = solution.gain < NOTHING
                break
            here = trial.place
            damping = damping / 10.0 if damping > 1e-8 else 0.0
        return End(here.x, here.at, here.alone, solution, steps, converged)

    def _moved(self, here: _Place, step: F64, floor_mm: float, held: bool) -> _Trial:
        """After a step (C,) of the unknowns, placements and targets following."""
        twist, shift = here.alone.follow(step)
        poses = here.at.poses.moved(here.at.centre_mm, twist, shift)
        return _Trial(self, here.x + step, poses, floor_mm, held)

    def _better(self, here: _Place, trial: _Trial, solution: Solution, held: bool) -> bool:
        """Whether a trial is taken: judged by what made it where placements are fitted anew or
        have followed it, but for less than it promises; otherwise by χ² where it stands."""
        leans = solution.off_drawing(trial.x - self.start)
        leans -= solution.off_drawing(here.x - self.start)
        clear, near = here.alone.clear_cost, solution.gain < NEAR * here.alone.cost
        if self._poses_anew(held):
            there = self._held_cost(here, trial) if near else trial.place.alone.clear_cost
            return there + leans <= clear
        cost = trial.place.alone.cost
        most = here.alone.cost + (solution.gain if near else 0.0)
        if cost + leans <= most:
            return True
        followed = cost - trial.place.alone.clear_cost <= solution.gain
        return near and followed and self._held_cost(here, trial) + leans <= clear

    def _held_cost(self, here: _Place, trial: _Trial) -> float:
        """What a trial costs with the weights and adjusted angles held of where it came from."""
        rows = parameter_rows(*self.unknowns.put(trial.x, self.constants, self.terms), self.basis)
        tip = observe(here.at.q, rows, self.observations.turned) - here.at.there_mm
        residual = trial.poses.residual(self.observations, here.at.position_mm + tip)
        return here.alone.clear_cost_of(residual, trial.poses)

    def linearise(
        self, x: F64, poses: Poses, floor_mm: float, held: bool
    ) -> tuple[Linearisation, ArmAlone]:
        """At the unknowns (C,), with poses as they are, or fitted anew while the fit is *held*."""
        constants, terms = self.unknowns.put(x, self.constants, self.terms)
        if self._poses_anew(held):
            # Far off, poses are not linear: about a beam's own axis they turn by any angle.
            rows = parameter_rows(constants, terms, self.basis)
            position = observe(self.observations.states.q, rows, self.observations.turned)
            poses = fit_poses(self.observations, position, self.weighting.weight, poses)
        at = linearise(self.observations, constants, terms, poses, self.reference_c, self.basis)
        return at, self._alone(at, floor_mm)

    def _alone(self, at: Linearisation, floor_mm: float) -> ArmAlone:
        columns = self.unknowns.columns(at.jacobian, at.basis, self.terms)
        return ArmAlone(at, self.weighting.compute_whitening(at.joints), columns, floor_mm)

    def _poses_anew(self, held: bool) -> bool:
        """Whether poses are fitted at every place, and do not follow the steps alone."""
        return held and not len(self.observations.distances.length_mm)

"""Gauss–Newton on the unknowns, with Levenberg's damping where a step fails."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from armd.arrays import F64
from armd.compensation.estimate.linear.solution import Solution
from armd.compensation.estimate.linearise import Linearisation, linearise
from armd.compensation.estimate.noise.reading import Weighting
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.orientations import compute_observed
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.estimate.placements.poses import Poses
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.arm_alone import ArmAlone
from armd.compensation.model.basis import compute_parameter_rows
from armd.compensation.model.terms import Term

MOST_STEPS = 40
#: A step that promises less than this share of the cost may be judged by what it was made of:
#: weights and adjusted angles held. How they follow is left out of the columns, and beside so small
#: a promise that shows (docs/decisions/0023). One that promises more is judged with both following.
NEAR = 0.01
#: A step that promises less (χ²) and does not keep it is not tried again with damping: forty short
#: ones would crawl towards what no figure shows.
NOTHING = 1e-3


@dataclass(frozen=True)
class End:
    """Where a descent came to rest."""

    x: F64
    linearisation: Linearisation
    arm_problem: ArmAlone
    solution: Solution
    steps: int
    converged: bool


@dataclass(frozen=True)
class _Place:
    """Where a descent stands."""

    x: F64
    linearisation: Linearisation
    arm_problem: ArmAlone


@dataclass
class _Trial:
    """Where a step leads; what it is there is found when it is asked for."""

    descent: Descent
    x: F64
    poses: Poses
    floor_mm: float
    with_prior: bool

    @cached_property
    def place(self) -> _Place:
        """Linearised there."""
        return _Place(
            self.x, *self.descent.linearise(self.x, self.poses, self.floor_mm, self.with_prior)
        )


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

    def run(self, x: F64, begun: Linearisation, floor_mm: float, with_prior: bool) -> End:
        """Step until what a step would gain is nothing beside the noise; *begun*: at *x* (C,), with
        poses to begin with."""
        scale = self.unknowns.get_plausible(self.terms, self.basis)

        if self._refits_poses(with_prior):
            place = _Place(x, *self.linearise(x, begun.poses, floor_mm, with_prior))
        else:
            place = _Place(x, begun, self._make_arm_problem(begun, floor_mm))
        damping = 0.0
        steps = 0
        while steps < MOST_STEPS:
            steps += 1
            pull = self.start - place.x
            solution = place.arm_problem.solve(scale, pull, along_all=with_prior)
            converged = solution.gain < 1e-6 + 1e-8 * place.arm_problem.cost
            if converged:
                break

            while True:
                damped = (
                    place.arm_problem.solve(scale, pull, damping, with_prior)
                    if damping
                    else solution
                )
                trial = self._move(place, damped.step, floor_mm, with_prior)
                better = self._is_better(place, trial, solution, with_prior)
                if not better:
                    # The way may bend, where a link turns with what hangs on it: a second step
                    # from there comes back to the valley's floor.
                    second_pull = self.start - trial.x
                    second = trial.place.arm_problem.solve(scale, second_pull, damping, with_prior)
                    trial = self._move(trial.place, second.step, floor_mm, with_prior)
                    better = self._is_better(place, trial, solution, with_prior)
                if better or damping > 1e3 or solution.gain < NOTHING:
                    break
                damping = max(10.0 * damping, 1e-6)
            if not better:  # no step gains anything
                converged = solution.gain < NOTHING
                break
            place = trial.place
            damping = damping / 10.0 if damping > 1e-8 else 0.0
        return End(place.x, place.linearisation, place.arm_problem, solution, steps, converged)

    def _move(self, place: _Place, step: F64, floor_mm: float, with_prior: bool) -> _Trial:
        """After a step (C,) of the unknowns, placements and targets following."""
        twist, shift = place.arm_problem.follow(step)
        poses = place.linearisation.poses.moved(place.linearisation.centre_mm, twist, shift)
        return _Trial(self, place.x + step, poses, floor_mm, with_prior)

    def _is_better(
        self, place: _Place, trial: _Trial, solution: Solution, with_prior: bool
    ) -> bool:
        """Whether a trial is taken: judged by what made it where placements are fitted anew or
        have followed it, but for less than it promises; otherwise by χ² where it stands."""
        leans = solution.off_drawing(trial.x - self.start)
        leans -= solution.off_drawing(place.x - self.start)
        start_cost, is_near = (
            place.arm_problem.clear_cost,
            solution.gain < NEAR * place.arm_problem.cost,
        )
        if self._refits_poses(with_prior):
            trial_cost = (
                self._compute_fixed_cost(place, trial)
                if is_near
                else trial.place.arm_problem.clear_cost
            )
            return trial_cost + leans <= start_cost
        cost = trial.place.arm_problem.cost
        limit = place.arm_problem.cost + (solution.gain if is_near else 0.0)
        if cost + leans <= limit:
            return True
        followed = cost - trial.place.arm_problem.clear_cost <= solution.gain
        return is_near and followed and self._compute_fixed_cost(place, trial) + leans <= start_cost

    def _compute_fixed_cost(self, place: _Place, trial: _Trial) -> float:
        """What a trial costs with the weights and adjusted angles held of where it came from."""
        rows = compute_parameter_rows(
            *self.unknowns.put(trial.x, self.constants, self.terms), self.basis
        )
        tip = (
            compute_observed(place.linearisation.q, rows, self.observations.turned)
            - place.linearisation.there_mm
        )
        residual = trial.poses.residual(self.observations, place.linearisation.position_mm + tip)
        return place.arm_problem.clear_cost_of(residual, trial.poses)

    def linearise(
        self, x: F64, poses: Poses, floor_mm: float, with_prior: bool
    ) -> tuple[Linearisation, ArmAlone]:
        """At the unknowns (C,), with poses as they are, or fitted anew in a round *with_prior*."""
        constants, terms = self.unknowns.put(x, self.constants, self.terms)
        if self._refits_poses(with_prior):
            # Far off, poses are not linear: about a beam's own axis they turn by any angle.
            rows = compute_parameter_rows(constants, terms, self.basis)
            position = compute_observed(self.observations.states.q, rows, self.observations.turned)
            poses = fit_poses(self.observations, position, self.weighting.weight, poses)
        linearisation = linearise(
            self.observations, constants, terms, poses, self.reference_c, self.basis
        )
        return linearisation, self._make_arm_problem(linearisation, floor_mm)

    def _make_arm_problem(self, linearisation: Linearisation, floor_mm: float) -> ArmAlone:
        columns = self.unknowns.columns(linearisation.jacobian, linearisation.basis, self.terms)
        return ArmAlone(
            linearisation, self.weighting.compute_whitening(linearisation.joints), columns, floor_mm
        )

    def _refits_poses(self, with_prior: bool) -> bool:
        """Whether poses are fitted at every place, and do not follow the steps alone."""
        return with_prior and not len(self.observations.distances.length_mm)
